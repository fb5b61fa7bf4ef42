"""What a file carries. A mode is a module here, with a value that knows how to encode and decode it.

    gaussians   planes of the network's output; any receiver decodes it. The default of small photos, and of two.
    photos      the photos and the network's hash: a quarter to a half of the planes' bytes at equal Q_g, for receivers
                that have the network.
    lossless    planes as float16, bit for bit.
    list        a list of Gaussians: what `compress` makes of a trained or an edited scene, and `encode` of a capture
                of larger photos.

docs/MODES.md has figures. Importing this package loads nothing, so that the command line can name modes.
"""

DEFAULT_MODE, PHOTOS, LIST, EITHER = "gaussians", "photos", "list", "auto"

CHOICES = (DEFAULT_MODE, PHOTOS, LIST, EITHER)
"""What a scene of photos can be encoded as; the last, as what shows photos of a capture better that were held back."""
