"""How wide a photo's pixel is where its Gaussian lies, and Gaussians widened by a share of it."""

from __future__ import annotations

import math
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


def widened(gaussians: Gaussians, variance: float) -> Gaussians:
    """Gaussians whose covariance is Σ + variance · (z/f)² · 1: closed surfaces wherever they are drawn.

    The 3-D filter of Mip-Splatting (Yu et al. 2024) in pixels of the own photo, without its change of opacity: for
    renderers that know of screen pixels alone, seen from closer than the photos or larger.

    Args:
        gaussians: per pixel, with cameras; all layers are widened by pixels of layer 0.
        variance: own pixels².

    Raises:
        InputError: a list, or a variance that is no finite number ≥ 0.
    """
    if not gaussians.is_per_pixel:
        raise InputError("a list has no pixels of its own", where="dilate")
    if not (isinstance(variance, Real) and 0 <= variance < math.inf):
        raise InputError(f"{variance!r}, expected a finite number ≥ 0 in own pixels²", where="dilate")

    def scales(layer: Gaussians) -> NDArray:
        views = zip(layer.means, gaussians.cameras, strict=True)
        pixels = np.stack([own_pixels(means, gaussians.origin, photo) for means, photo in views])
        added = np.float64(variance) * np.square(pixels, dtype=np.float64)
        return np.sqrt(np.square(layer.scales, dtype=np.float64) + added[..., None])

    return Gaussians.stacked([replace(layer, scales=scales(layer)) for layer in gaussians.layers])
