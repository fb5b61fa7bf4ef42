"""The photos that Gaussians are held against, whole and smaller.

Trust boundary: values have to be numbers.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...render.gradient import Target
from ...scene.cameras import Camera
from ...scene.scenes import Frame
from ...system import disk

NOTHING = 0.0
"""Colour of a photo's pixels where a mask says that nothing is, so that Gaussians of other photos fade that show there.
Where something moved, nobody judges them."""


def targets_of(cameras: Sequence[Camera], frames: Sequence[Frame]) -> list[Target]:
    """Photos of one size, and where nothing is in them, of a capture on disk.

    Args:
        cameras: of the photos, of one size.
        frames: which they are, of that size.

    Raises:
        InputError: a photo that cannot be read.
    """
    photos = disk.zeros((len(cameras), cameras[0].height, cameras[0].width, 3))
    shares = disk.zeros(photos.shape[:3]) if any(frame.is_on_background for frame in frames) else None
    targets = []
    for view, (camera, photo, frame) in enumerate(zip(cameras, photos, frames, strict=True)):
        photo[:] = frame.image()
        if not np.isfinite(photo).all():
            raise InputError("holds NaN or infinity, expected RGB in [0, 1]", where="photos")
        nothing = None
        if (known := frame.known()) is not None:
            photo[~known] = NOTHING if frame.is_on_background else np.nan
            if shares is not None and frame.is_on_background:
                nothing = shares[view]
                nothing[:] = ~known
        targets.append(Target(camera, photo, nothing=nothing))
    return targets


def halved(targets: Sequence[Target]) -> list[Target]:
    """Photos of half the size, of a capture on disk; a last row or column without a partner goes."""
    height, width = (size // 2 for size in targets[0].photo.shape[:2])
    photos = disk.zeros((len(targets), height, width, 3))
    shares = None if all(target.nothing is None for target in targets) else disk.zeros(photos.shape[:3])
    smaller = []
    for view, target in enumerate(targets):
        K, nothing = target.camera.K.copy(), None
        K[:2] /= 2
        photos[view] = _halved(target.photo)
        if shares is not None and target.nothing is not None:
            shares[view], nothing = _halved(target.nothing), shares[view]
        smaller.append(Target(Camera(K, target.camera.c2w, width, height), photos[view], nothing))
    return smaller


def _halved(picture: NDArray) -> NDArray:
    """(H, W, …) to half the size."""
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    return picture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, *picture.shape[2:]).mean(axis=(1, 3))
