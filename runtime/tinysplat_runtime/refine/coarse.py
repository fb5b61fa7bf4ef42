"""Smaller copies of Gaussians and their photos, in which steps cost a quarter, and the way back to every pixel.

Most of what refinement mends is wrong over many pixels: surfaces that stand before others, colours, opacities. A copy
with one Gaussian for every 2×2 finds it in a quarter of the time; what it changed is added to the Gaussians of all
pixels, smoothly, and a few steps at full size do the rest. A copy does not look quite like its original, so its
photos are changed until it lacks at the start what the original does (Brandt 1977, full approximation scheme): what
copying alone made wrong is not corrected, which the original would have to undo.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import FIELDS, Gaussians
from ..render.gradient import MovableGaussians, Target
from ..render.kernels_place import VALUES
from ..scene.cameras import Camera
from ..system import disk
from .settings import LIMITS


def halved(gaussians: Gaussians) -> Gaussians:
    """One Gaussian for every 2×2 of a layer's pixels, twice as large; a last row or column without a partner goes."""
    layers = [
        Gaussians.unchecked(
            **{name: _smaller(name, getattr(layer, name)) for name in FIELDS},
            cameras=tuple(halved_camera(camera) for camera in layer.cameras),
            origin=layer.origin,
        )
        for layer in gaussians.layers
    ]
    return Gaussians.stacked(layers)


def halved_camera(camera: Camera) -> Camera:
    """Of a picture of half the size."""
    K = camera.K.copy()
    K[:2] /= 2
    return Camera(K, camera.c2w, camera.width // 2, camera.height // 2)


def halved_picture(picture: NDArray) -> NDArray:
    """(H, W, …) to half the size, float32."""
    return _pooled(picture, (picture.shape[0] // 2, picture.shape[1] // 2))


def halved_target(target: Target) -> Target:
    """A photo of half the size."""
    smaller = replace(target, camera=halved_camera(target.camera), photo=halved_picture(target.photo))
    return smaller if target.nothing is None else replace(smaller, nothing=halved_picture(target.nothing))


def lacking_alike(targets: Sequence[Target], pictures: NDArray, moving: MovableGaussians) -> list[Target]:
    """Photos of half the size, changed so that a halved copy lacks of them what its original lacks.

    Args:
        targets: the photos.
        pictures: (V, H/2, W/2, 3) float32, halved, of the photos' cameras by the original, near views first; the photos
            take their place.
        moving: the copy.
    """
    shown, found = np.zeros((*pictures.shape[1:3], 4), np.float32), list[Target]()
    for target, picture in zip(targets, pictures, strict=True):
        half = halved_target(target)
        moving.measure(half, shares=moving.shares(half.camera), shown=shown)
        picture[:] = half.photo + shown[..., :3] - picture
        found.append(replace(half, photo=picture))
    return found


def bring_up(field: MovableGaussians, smaller: MovableGaussians, start: NDArray) -> None:
    """Add a halved copy's changes to its original; `start` are the copy's first values, (6, rows) float32."""
    for whole, half in zip(field.grids, smaller.grids, strict=True):
        change = (smaller.values[:, half.rows] - start[:, half.rows]).reshape(VALUES, half.height, half.width)
        for axis, size in ((1, whole.height), (2, whole.width)):
            change = _doubled(change, axis, size)
        values = field.values[:, whole.rows]
        for kind, (least, greatest) in enumerate(LIMITS):
            low, high = np.minimum(values[kind], least), np.maximum(values[kind], greatest)
            values[kind] = (values[kind] + change[kind].ravel()).clip(low, high)


def _smaller(name: str, array: NDArray) -> NDArray:
    """A field (V, H, W, …) of the halved copy, of a capture on disk."""
    shape = array.shape[1] // 2, array.shape[2] // 2
    halves = disk.zeros((len(array), *shape, *array.shape[3:]))
    for view, half in zip(array, halves, strict=True):
        if name == "quats":  # of the first, as turns have no mean
            half[:] = view[: 2 * shape[0] : 2, : 2 * shape[1] : 2]
        else:
            half[:] = (2 if name == "scales" else 1) * _pooled(view, shape)
    return halves


def _pooled(array: NDArray, shape: tuple[int, int]) -> NDArray:
    """(2h, 2w, …), or a little more, to means (h, w, …) float32."""
    height, width = shape
    blocks = array[: 2 * height, : 2 * width].reshape(height, 2, width, 2, *array.shape[2:])
    return np.ascontiguousarray(blocks.mean(axis=(1, 3)), np.float32)


def _doubled(array: NDArray, axis: int, size: int) -> NDArray:
    """Twice as long along an axis, or one more, by linear interpolation between the centres of samples."""
    at = (np.arange(size) - 0.5) / 2
    last = array.shape[axis] - 1
    low = np.floor(at).astype(int)
    share = np.reshape(at - low, [-1 if n == axis else 1 for n in range(array.ndim)]).astype(np.float32)
    before, behind = (array.take(index.clip(0, last), axis=axis) for index in (low, low + 1))
    return before + share * (behind - before)
