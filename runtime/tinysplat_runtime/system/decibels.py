"""Errors of pictures in decibels, by one formula with one ceiling."""

from __future__ import annotations

import math

CEILING = 150.0
"""dB of pictures that are equal, where float32's own rounding lies: JSON has no infinity."""


def decibels(squared_error: float) -> float:
    """Peak signal-to-noise ratio in dB of a mean squared error of values in [0, 1], at most CEILING."""
    return -10 * math.log10(max(squared_error, 10 ** (-CEILING / 10)))
