"""What a file carries. A mode is a module here, with a value that knows how to encode and decode it.

    gaussians   planes of the network's output; any receiver decodes it. The default of two photos, and without numba.
    photos      the photos and the network's hash: a quarter to a half of the planes' bytes at equal Q_g, for receivers
                that have the network.
    lossless    planes as float16, bit for bit.
    list        a list of Gaussians: what `compress` makes of a trained or an edited scene, and `encode` of three photos
                or more.

docs/MODES.md has figures. Importing this package loads nothing, so that the command line can name modes.
"""

DEFAULT_MODE, PHOTOS, LIST = "gaussians", "photos", "list"

CHOICES = (DEFAULT_MODE, PHOTOS, LIST)
"""What a scene of photos can be encoded as."""
