"""Values to 12-bit codes and a QP, such that the video codec's step is a wanted one in the values' own units.

An HEVC quantiser step is 2^(b−8)·2^((QP−4)/6) codes at b bits, 16·2^((QP−4)/6) at 12. A channel of values scaled by s
codes per unit is thus quantised with the step 16·2^((QP−4)/6)/s units: any pair (QP, s) on that curve codes alike, so
the pair is chosen to use the code range well. docs/CODEC.md, "Steps as codes", has the mapping from the paper's 14 bits
and what it costs.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..gaussian.planes import MAX_CODE, hevc_step

MID_CODE = 2048
MAX_MAPPED_QP = 24
"""Highest QP used: above it, codes would become so few that their rounding shows; below 16 bytes are wasted."""

_VALUES_AT_A_TIME = 1 << 14

OUTLIER_RATIO = 4.0
"""Coarsening that is borne to keep every value of a plane."""

OUTLIER_SHARE = 1e-3
"""Largest share of a plane's values that may be clipped to spare the rest more than that."""


@dataclass(frozen=True)
class CodeMap:
    """value = offset + code · scale, and the QP at which the plane is coded.

    Attributes:
        scale: units per code, > 0; 0 where `offset` stands for all values and no plane is coded.
        offset: value of code 0.
        qp: 0 to 51.
    """

    scale: float
    offset: float
    qp: int

    @property
    def step(self) -> float:
        """The video codec's quantiser step in the values' units."""
        return hevc_step(self.qp) * self.scale

    def quantise(self, values: NDArray) -> tuple[NDArray, int]:
        """Codes of values.

        Args:
            values: any shape, float32.

        Returns:
            uint16 codes of the same shape, and how many values lay outside the range and were clipped.
        """
        codes = values - np.float32(self.offset)
        codes *= np.float32(1 / self.scale)
        np.rint(codes, out=codes)
        clipped = int(np.count_nonzero((codes < 0) | (codes > MAX_CODE)))
        return np.clip(codes, 0, MAX_CODE, out=codes).astype(np.uint16), clipped

    def dequantise(self, codes: NDArray) -> NDArray:
        """float32 values of codes of any shape, integer."""
        return codes.astype(np.float32) * np.float32(self.scale) + np.float32(self.offset)


def extent(values: NDArray) -> tuple[float, float]:
    """Smallest and largest value of planes (V, H, W)."""
    lows, highs = zip(*((of_view.min(), of_view.max()) for of_view in values), strict=True)
    return float(np.min(lows)), float(np.max(highs))


def mean_of(values: NDArray) -> float:
    """Mean of planes (V, H, W) float32, in float64."""
    return float(np.mean([of_view.mean(dtype=np.float64) for of_view in values]))


def mean_and_spread(values: NDArray) -> tuple[float, float]:
    """Mean and standard deviation of planes (V, H, W) float32, in float64 and some rows at a time."""
    mean = mean_of(values)
    rows, squares = max(_VALUES_AT_A_TIME // values.shape[2], 1), 0.0
    for of_view in values:
        for first in range(0, len(of_view), rows):
            rest = np.subtract(of_view[first : first + rows], mean, dtype=np.float64).ravel()  # numpy 1 takes float32
            squares += float(np.einsum("i,i", rest, rest))  # no BLAS, whose last bits depend on threads
    return mean, math.sqrt(squares / values.size)


def choose_code_map(low: float, high: float, mean: float, step: float) -> CodeMap:
    """The code map that gives the wanted step, or the finest there is where 12 bits cannot.

    The highest usable QP makes the codes span the range; where it would be below 0, QP and scale are clamped together
    (clamping the QP alone would let codes overflow) and the step comes out coarser than wanted. The mean lies at code
    2048 where the range allows, so that coarse steps do not lose the first block's DC.

    Args:
        low, high: range to represent, low < high.
        mean: mean of the values.
        step: wanted quantiser step in the same units, > 0.
    """
    span = high - low
    qp = math.floor(4 + 6 * math.log2(step * MAX_CODE / (hevc_step(4) * span)))
    if qp < 0:
        return _rounded(span / MAX_CODE, low, 0)
    qp = min(qp, MAX_MAPPED_QP)
    scale = step / hevc_step(qp)
    offset = max(min(mean - MID_CODE * scale, low), high - MAX_CODE * scale)
    return _rounded(scale, offset, qp)


def without_outliers(values: NDArray, low: float, high: float, step: float) -> tuple[float, float]:
    """The range to represent, without the few values that would ruin all others.

    12 bits hold about 400 steps. Where the range asks for `OUTLIER_RATIO` times as many and all but a share of
    `OUTLIER_SHARE` of the values lie in a range `OUTLIER_RATIO` times smaller, those few are left out: they are
    clipped and counted, where otherwise every value of the plane would come out that much coarser.

    Args:
        values: any shape, float.
        low, high: range of the values, or a part of it.
        step: wanted quantiser step in the same units, > 0.
    """
    reachable = step * MAX_CODE / hevc_step(0)
    if high - low <= OUTLIER_RATIO * reachable:
        return low, high
    few = max(1, int(values.size * OUTLIER_SHARE / 2))
    if 2 * few + 1 >= values.size:
        return low, high
    least, most = _extremes(values, few + 1)
    inner = max(least, low), min(most, high)
    margin = max(inner[1] - inner[0], reachable) / 2  # so that only what lies far out is cut
    kept = max(low, inner[0] - margin), min(high, inner[1] + margin)
    return kept if OUTLIER_RATIO * (kept[1] - kept[0]) < high - low else (low, high)


def _extremes(values: NDArray, rank: int) -> tuple[float, float]:
    """The number of that rank from the smallest, and from the largest; planes (V, H, W) are gone through by view."""
    least = most = np.empty(0, values.dtype)
    for part in values if values.ndim > 2 else [values]:
        low, high = (np.concatenate([kept, part.ravel()]) for kept in (least, most))
        least = np.partition(low, rank - 1)[:rank] if len(low) > rank else low
        most = np.partition(high, -rank)[-rank:] if len(high) > rank else high
    return float(least.max()), float(most.min())


def _rounded(scale: float, offset: float, qp: int) -> CodeMap:
    # The file stores both as float32; using the stored numbers from here on keeps encoder and decoder in step.
    return CodeMap(float(np.float32(scale)), float(np.float32(offset)), qp)
