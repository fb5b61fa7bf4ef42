"""Whether a file holds values as its format has them: trainers keep logarithms of scales, and logits of opacities.

Written without the function that turns one into the other, they are Gaussians of another size or opacity, which no
bound refuses. How large Gaussians are is told by how far apart they lie, so that the unit of a scene does not matter.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..gaussian.curve import morton_order

TELLING = 16
"""Gaussians from which on values of all of them tell something."""

LARGE, USUAL, SMALL = 8.0, 0.2, 0.05
"""Distances between neighbours that the median Gaussian's scale exceeds, has at least, and stays below: the first and
the last where it is no scale. Of trained scenes it is 0.2 to 2."""

OVERLAP = 1.5
"""Distances between neighbours that the median Gaussian's scale exceeds, too, where its logarithm is as usual."""

_BESIDE = 16  # Gaussians along a curve that are looked at for the nearest one
_LOOKED = 4096  # whose neighbours are looked for
_MOST_LOGARITHM = 30.0
_HARDLY_ANY = 99.5  # percent of Gaussians that are smaller than a few giants
_OPACITY_OF_OPACITY = (0.5, 0.7311)  # what the sigmoid makes of 0 and 1


def activation_doubts(arrays: Mapping[str, NDArray]) -> list[str]:
    """What points to values that were activated twice, or never, a line each.

    Args:
        arrays: linear `means` (N, 3), `scales` (N, 3) and `opacities` (N,) of a list; others tell nothing.
    """
    means, scales, opacities = (arrays.get(name, np.zeros(0)) for name in ("means", "scales", "opacities"))
    if means.ndim != 2 or means.shape != scales.shape or len(means) < TELLING:
        return []
    with np.errstate(invalid="ignore", over="ignore"):
        told = ~(np.isnan(means).any(axis=1) | np.isnan(scales).any(axis=1) | np.isnan(opacities))
        if told.sum() < TELLING:
            return []
        return [*_opacity_doubts(opacities[told]), *_scale_doubts(means[told], scales[told])]


def _opacity_doubts(opacities: NDArray) -> list[str]:
    low, high = _OPACITY_OF_OPACITY
    if not low <= opacities.min() < opacities.max() <= high:
        return []
    return ["opacities lie within 0.5 and 0.731 everywhere: linear values, where logits are expected?"]


def _scale_doubts(means: NDArray, scales: NDArray) -> list[str]:
    least, typical, most = scales.min(), float(np.median(scales)), float(np.percentile(scales, _HARDLY_ANY))
    if least < 1 and not (least > 0 and SMALL < typical < most < _MOST_LOGARITHM):
        return []
    apart, extent = _spread(means)
    if apart < np.finfo(np.float32).tiny:  # all at one place, beside which any size is large
        return []
    text = f"scales are {typical / apart:.3g} times as large as Gaussians lie apart"
    if least >= 1 and (
        typical > LARGE * apart
        or (np.log(typical) > USUAL * apart and (typical > OVERLAP * apart or most > extent))  # what sizes are like
    ):
        return [f"{text}: linear values, where their logarithms are expected?"]
    if most < _MOST_LOGARITHM and typical < SMALL * apart < np.exp(typical) < LARGE * apart:
        return [f"{text}: logarithms, where linear values are expected?"]
    return []


def _spread(means: NDArray) -> tuple[float, float]:
    """About how far the nearest neighbour of a point (N, 3) lies, the median, and how far all of them reach."""
    means = means[np.isfinite(means).all(axis=1)]
    if len(means) < TELLING:
        return np.inf, np.inf
    low, high = np.percentile(means, (5, 95), axis=0)
    means = means[morton_order(means)].astype(np.float64)
    looked = np.unique(np.linspace(0, len(means) - 1, min(len(means), _LOOKED)).astype(int))
    steps = np.array([step for step in range(-_BESIDE, _BESIDE + 1) if step])
    beside = looked[:, None] + steps
    away = np.linalg.norm(means[beside.clip(0, len(means) - 1)] - means[looked, None], axis=2)
    away[(beside < 0) | (beside >= len(means))] = np.inf
    return max(float(np.median(away.min(axis=1))), np.finfo(np.float64).tiny), float((high - low).max())
