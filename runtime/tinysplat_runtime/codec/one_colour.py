"""SH coefficients of degree 0 that show a layer's colours as the input views see them, where these agree.

A Gaussian of a pixel is looked at along its own camera's ray and those of cameras near it. Where its colour hardly
differs among them, one colour says what all its coefficients do, and says it better than the leading components of all
coefficients: those serve every direction in which some pixel is seen, this one the pixel's own. A decoder finds plain
degree 0. What it gains: docs/CODEC.md.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..gaussian.sh import C0, sh_degree, sh_terms
from ..scene.cameras import Camera
from ..system import disk

AVERAGED = 2
"""Cameras whose view of a Gaussian becomes its colour: its own and the one nearest to that."""

COMPARED = 8
"""Cameras, by distance, whose view of it is compared with that colour."""

SAMPLED = 4
"""The comparison looks at every so many-th row and column."""

_STRIP_PX = 4096
"""Pixels worked on at a time, whose coefficients stay in a core's cache."""


def as_seen(layer: Gaussians, budget: float) -> Gaussians | None:
    """The layer at degree 0, or None where the input views disagree by more than the budget about its colours.

    Args:
        layer: per pixel, with cameras; of any degree.
        budget: mean squared difference, summed over the three colours, between what an input camera sees of a Gaussian
            and the colour that takes its place.

    Returns:
        The layer with sh (V, H, W, 1, 3) float32 and without extra layers. None also where there is nothing to compare:
        at degree 0, with one view, or with colours beyond float32.
    """
    if layer.degree == 0 or len(layer.cameras) < 2:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        if not disagreement(layer) <= budget:  # also when it is no number
            return None
        is_finite = True
        sh = disk.zeros((*layer.opacities.shape, 1, 3))
        for view, cameras in enumerate(nearest_cameras(layer.cameras)):
            centres = _centres(layer, cameras[:AVERAGED])
            rows = max(1, _STRIP_PX // sh.shape[2])
            for start in range(0, sh.shape[1], rows):
                strip = slice(start, start + rows)
                colors = _seen_from(layer.means[view, strip], layer.sh[view, strip], centres)
                sh[view, strip, :, 0] = colors / np.float32(C0)
            is_finite = is_finite and bool(np.isfinite(sh[view]).all())
    if not is_finite:
        return None
    return layer.changed(sh=sh, extra_layers=())


def disagreement(layer: Gaussians) -> float:
    """Mean squared difference, summed over the three colours, between what each of the nearest cameras sees of a
    Gaussian and what the `AVERAGED` nearest see on average; from a sample of the pixels.
    """
    total, count = 0.0, 0
    for view, cameras in enumerate(nearest_cameras(layer.cameras)):
        means, sh = layer.means[view, ::SAMPLED, ::SAMPLED], layer.sh[view, ::SAMPLED, ::SAMPLED]
        centres = _centres(layer, cameras[:COMPARED])
        mean = _seen_from(means, sh, centres[:AVERAGED])
        for centre in centres:
            squared = np.square(_seen_from(means, sh, centre[None]) - mean).sum(axis=-1)
            total += float(squared.sum(dtype=np.float64))
            count += squared.size
    return total / count


def nearest_cameras(cameras: Sequence[Camera]) -> NDArray:
    """(V, V) int: for every camera, all of them by rising distance between centres, itself first."""
    centres = np.stack([camera.centre for camera in cameras])
    distances = np.linalg.norm(centres[:, None] - centres, axis=-1)
    np.fill_diagonal(distances, -1.0)
    return np.argsort(distances, axis=1, kind="stable")


def _centres(layer: Gaussians, cameras: NDArray) -> NDArray:
    """(n, 3) float32 relative to the layer's origin, as its means are."""
    return np.stack([layer.cameras[camera].centre - layer.origin for camera in cameras]).astype(np.float32)


def _seen_from(means: NDArray, sh: NDArray, centres: NDArray) -> NDArray:
    """Colours (h, w, 3), less 0.5, of Gaussians (h, w, …), averaged over camera centres (n, 3)."""
    x, y, z = (means[..., axis] - centres[:, axis, None, None] for axis in range(3))  # (n, h, w)
    lengths = np.maximum(np.sqrt(x * x + y * y + z * z), np.finfo(np.float32).tiny)
    terms = sh_terms(x / lengths, y / lengths, z / lengths, sh_degree(sh.shape[-2]))
    basis = np.empty(sh.shape[:-1], x.dtype)
    basis[..., 0] = C0
    for index, term in enumerate(terms, 1):
        np.add.reduce(term, axis=0, out=basis[..., index])
    basis[..., 1:] /= len(centres)
    # A colour at a time: einsum is twice as fast where it sums into a single number.
    return np.stack([np.einsum("...b,...b->...", basis, sh[..., colour]) for colour in range(3)], axis=-1)
