"""How wide a photo's pixel is where its Gaussian lies, and Gaussians widened by a share of it."""

import math
from collections.abc import Iterable
from dataclasses import replace
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..scene.cameras import Camera
from .gaussians import Gaussians


def own_pixels(means: NDArray, origin: NDArray, photo: Camera) -> NDArray:
    """Width of a photo's pixel at the depth of Gaussians that stand for it, z / f.

    Args:
        means: (…, 3) float32, relative to the origin.
        origin: (3,) float64.
        photo: the view that they are of.

    Returns:
        (…) float32 in scene units; 0 where they lie behind the view.
    """
    z = (means + (origin - photo.centre)) @ photo.rotation[2]
    return (np.maximum(z, 0) / photo.focal).astype(np.float32)


def nearest_pixels(means: NDArray, origin: NDArray, photos: Iterable[Camera]) -> NDArray:
    """The same of the photo that shows each of (N, 3) Gaussians largest; 0 for those behind all photos."""
    least = np.full(len(means), np.inf, np.float32)
    for photo in photos:
        width = own_pixels(means, origin, photo)
        np.minimum(least, width, out=least, where=width > 0)
    return np.where(np.isfinite(least), least, np.float32(0))


def widened(gaussians: Gaussians, variance: float) -> Gaussians:
    """Gaussians whose covariance is Σ + variance · (z/f)² · 1: closed surfaces wherever they are drawn.

    The 3-D filter of Mip-Splatting (Yu et al. 2024) in pixels of the own photo, without its change of opacity: for
    renderers that know of screen pixels alone, seen from closer than the photos or larger.

    Args:
        gaussians: per pixel, with cameras, all layers of which are widened by pixels of layer 0; or a list that knows
            its photos, by pixels of that which shows each largest.
        variance: own pixels².

    Raises:
        InputError: a list that knows no photos, or a variance that is no finite number ≥ 0.
    """
    if not (gaussians.is_per_pixel or gaussians.viewpoints):
        raise InputError("a list that knows no photos has no pixels of its own", where="dilate")
    if not (isinstance(variance, Real) and 0 <= variance < math.inf):
        raise InputError(f"{variance!r}, expected a finite number ≥ 0 in own pixels²", where="dilate")

    def scales(layer: Gaussians) -> NDArray:
        if gaussians.is_per_pixel:
            views = zip(layer.means, gaussians.cameras, strict=True)
            pixels = np.stack([own_pixels(means, gaussians.origin, photo) for means, photo in views])
        else:
            pixels = nearest_pixels(layer.means, gaussians.origin, gaussians.viewpoints)
        added = np.float64(variance) * np.square(pixels, dtype=np.float64)
        return np.sqrt(np.square(layer.scales, dtype=np.float64) + added[..., None])

    return Gaussians.stacked([replace(layer, scales=scales(layer)) for layer in gaussians.layers])
