"""How a photo was exposed beside a picture of what it shows: from how most of their pixels differ."""

import math

import numpy as np
from numpy.typing import NDArray

OUTLIER, ROUNDS = 0.06, 4
"""Difference, as exposed, from which a pixel's weight falls, and rounds of estimating with such weights: what a photo
shows of something else says nothing of its exposure.
"""

MOST_PIXELS = 1 << 14
"""Taken of a photo: enough to tell a gain to a thousandth."""


def log_gain(picture: NDArray, photo: NDArray) -> float:
    """By how much pixels (n,) of a photo are brighter than their picture's, by robust least squares; a tenth to ten
    times.
    """
    few = slice(None, None, len(picture) // MOST_PIXELS + 1)
    seen, wanted = picture[few].astype(np.float64), photo[few].astype(np.float64)
    weighted, gain = seen, 1.0
    for _ in range(ROUNDS):
        gain = min(max(float(weighted @ wanted) / max(float(weighted @ seen), 1e-9), 0.1), 10.0)
        weighted = seen / (1 + np.square((wanted - gain * seen) / OUTLIER))
    return math.log(gain)
