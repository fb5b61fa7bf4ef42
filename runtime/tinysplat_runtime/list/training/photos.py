"""The photos that Gaussians are held against, whole and smaller.

Trust boundary: values have to be numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

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


def halved_target(target: Target) -> Target:
    """A photo of half the size; a last row or column without a partner goes."""
    camera, K = target.camera, target.camera.K.copy()
    K[:2] /= 2
    smaller = replace(
        target, camera=Camera(K, camera.c2w, camera.width // 2, camera.height // 2), photo=_halved(target.photo)
    )
    return smaller if target.nothing is None else replace(smaller, nothing=_halved(target.nothing))


def _halved(picture: NDArray) -> NDArray:
    """(H, W, …) to half the size, float32."""
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    blocks = picture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, *picture.shape[2:])
    return np.ascontiguousarray(blocks.mean(axis=(1, 3)), np.float32)
