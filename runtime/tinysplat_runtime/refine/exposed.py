"""How a photo was exposed beside a picture of what it shows: from how all their pixels differ."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

OTHER_EXPOSURE, MOST_EXPOSURE = 0.3, 1.5
"""Natural logarithms of a photo's contrast over its picture's, between which it may be exposed otherwise."""


def log_gain(picture: NDArray, photo: NDArray) -> float:
    """By how much pixels (n,) of a photo are brighter than their picture's, by least squares; a tenth to ten times."""
    seen, wanted = picture.astype(np.float64), photo.astype(np.float64)
    return math.log(min(max(float(seen @ wanted) / max(float(seen @ seen), 1e-9), 0.1), 10.0))


def exposure_of(photo: NDArray, picture: NDArray) -> tuple[float, float]:
    """Gain and offset that give a picture (H, W, 3) a photo's mean and contrast, where that is far from its own; else
    1 and 0: what is nearer is found in steps.
    """
    known = np.isfinite(photo[..., 0])
    wanted, shown = photo[known], picture[known]
    if not known.any():
        return 1.0, 0.0
    gain = float(wanted.std(dtype=np.float64) / (shown.std(dtype=np.float64) + 1e-6))
    if not OTHER_EXPOSURE < abs(math.log(gain + 1e-6)) < MOST_EXPOSURE:
        return 1.0, 0.0
    return gain, float(wanted.mean(dtype=np.float64) - gain * shown.mean(dtype=np.float64))
