"""Arrays as two numbers that a change of any part of them moves, and that a processor's last bits do not."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def print_of(values: ArrayLike) -> tuple[float, float]:
    """Mean magnitude, and the mean under weights that differ from element to element."""
    flat = np.asarray(values, np.float64).ravel()
    weights = 1 + np.cos(0.7 * np.arange(flat.size) ** 1.1)
    return float(np.abs(flat).mean()), float((flat * weights).mean())
