"""Errors of pictures in decibels, by one formula with one ceiling."""

import math
import statistics
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

CEILING = 150.0
"""dB of pictures that are equal, where float32's own rounding lies: JSON has no infinity."""


def decibels(squared_error: float) -> float:
    """Peak signal-to-noise ratio in dB of a mean squared error of values in [0, 1], at most CEILING."""
    return -10 * math.log10(max(squared_error, 10 ** (-CEILING / 10)))


def mean_decibels(pictures: Iterable[NDArray], wanted: Iterable[NDArray]) -> float:
    """PSNR in dB of pictures (H, W, 3) float in [0, 1] to others of their shapes, the mean over the pairs.

    Values that are NaN in the others do not count, nor pairs of which none does; NaN where that leaves nothing.
    """
    pairs = ((one, other, ~np.isnan(other)) for one, other in zip(pictures, wanted, strict=True))
    errors = [
        np.mean((one - other) ** 2, dtype=np.float64, where=counts) for one, other, counts in pairs if counts.any()
    ]
    return statistics.fmean(decibels(float(error)) for error in errors) if errors else math.nan
