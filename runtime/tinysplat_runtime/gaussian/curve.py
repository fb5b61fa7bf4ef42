"""Lists of points in an order in which neighbours in space are neighbours in the list."""

import numpy as np
from numpy.typing import NDArray

_BITS = 21  # of each coordinate, 63 in all


def morton_order(points: NDArray) -> NDArray:
    """Indices (N,) intp that sort points (N, 3) float along a Morton curve in their box; ties keep their order."""
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    cells = (points - low) / np.where(high > low, high - low, 1) * ((1 << _BITS) - 1)
    return np.argsort(morton_keys(cells), kind="stable")


def morton_keys(cells: NDArray) -> NDArray:
    """(N,) uint64 that rise along the curve, of (N, 3) numbers from 0 to below 2²¹, cut to whole ones."""
    key = np.zeros(len(cells), np.uint64)
    for axis in range(3):
        key |= _spread(cells[:, axis].astype(np.uint64)) << np.uint64(axis)
    return key


def cells_of(keys: NDArray) -> NDArray:
    """(N, 3) float64 whole numbers of `morton_keys`."""
    return np.stack([_gathered(keys >> np.uint64(axis)) for axis in range(3)], axis=1).astype(np.float64)


_SPREADS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def _spread(values: NDArray) -> NDArray:
    """Bits of 21-bit numbers (any shape, uint64), each followed by two zeros."""
    for shift, mask in _SPREADS:
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values


def _gathered(keys: NDArray) -> NDArray:
    """Every third bit of numbers below 2⁶³ (any shape, uint64), from the lowest: the inverse of `_spread`."""
    values = keys & np.uint64(_SPREADS[-1][1])
    masks = [mask for _, mask in _SPREADS[-2::-1]] + [(1 << _BITS) - 1]
    for (shift, _), mask in zip(_SPREADS[::-1], masks, strict=True):
        values = (values | values >> np.uint64(shift)) & np.uint64(mask)
    return values
