"""Where Gaussians of a list can lie: a grid in the scene's bulk, and on logarithms beyond."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...container.list import MAX_LEVELS, PointGrid

NOT_FAR = 99.5
"""Percentile beyond which what lies far out makes cells no finer."""

FINEST, RADII = 5, 9
"""One of so many Gaussians of a place is of its finest part; and radii of its grid that are tried, in octaves."""

LEAST_BULK = 1e-12
"""Radius of a scene's bulk, over that of all of it, that is told from a point."""

WIDE = 24.0
"""Contracted coordinates across, above which the last cell that a file could name ends where Gaussians do: one twice as
far would lie beyond all numbers.
"""

MAX_CELL = 0.25

BULK = (5, 95)
"""Percentiles between which the scene's bulk lies, along each axis."""


def grid_of(means: NDArray, sizes: NDArray | None, cell: float) -> tuple[PointGrid, NDArray]:
    """The grid for (N, 3) positions, and (N, 3) how far they lie from its lowest corner.

    The more Gaussians, the less each may be off: `cell` is a cell's side times √N, in units of the scene's radius. With
    `sizes` (N,), those about Gaussians of a place, it is in these, and the place's finest part is the middle of its
    grid, so that cells grow from there as Gaussians do.
    """
    low, high = np.percentile(means, BULK, axis=0)
    centre = (low + high) / 2
    reach = float(np.abs(means - centre).max())
    # What lies far out must not make cells of the rest larger, nor a bulk in one point the rest infinitely far.
    radius = max(float(np.linalg.norm(high - low)) / 2, LEAST_BULK * reach) or 1.0
    side = 1 / math.sqrt(len(means))
    if sizes is not None:
        centre, radius, side = _about_the_finest(means, sizes, centre, radius)
    space = _contracted((means - centre) / radius)
    lowest = space.min(axis=0)
    space -= lowest
    return with_cell(PointGrid(centre, radius, 0.0, lowest, (), 0, 0, ()), cell * side, space), space


def _about_the_finest(means: NDArray, sizes: NDArray, middle: NDArray, radius: float) -> tuple[NDArray, float, float]:
    """Centre, radius and cell of sizes of Gaussians of the grid that takes the fewest bits.

    A cell's side, in sizes of Gaussians, has the same mean square in all of them.
    """
    finest = np.median(means[np.argsort(sizes, kind="stable")[: max(len(means) // FINEST, 1)]], axis=0)
    found: list[tuple[float, NDArray, float, float]] = []
    for centre in (middle, finest):
        away = np.abs(means - centre)
        for octave in range(RADII):
            inner = radius * 2.0**-octave
            sides = np.maximum(inner, away)
            shares = sides / sizes[:, None]
            each = math.sqrt(np.square(np.minimum(shares, np.percentile(shares, NOT_FAR))).mean())
            found.append((math.log(each) - float(np.log(sides).mean()), centre, inner, 1 / each))
    return min(found, key=lambda one: one[0])[1:]


def with_cell(grid: PointGrid, cell: float, space: NDArray) -> PointGrid:
    """The grid with about that cell, for (N, 3) contracted coordinates from its lowest corner."""
    reach = float(space.max())
    cell = max(min(cell, MAX_CELL), reach / ((1 << MAX_LEVELS) - 1))
    if reach > WIDE:
        cell = reach / ((1 << math.ceil(math.log2(reach / cell + 1))) - 1)
    return replace(grid, cell=cell)


def cells_in(grid: PointGrid, space: NDArray) -> NDArray:
    """(N, 3) float64 whole numbers, the cells of contracted coordinates (N, 3) from the lowest corner."""
    return np.rint(space / grid.cell).clip(0, (1 << MAX_LEVELS) - 1)


def means_of(grid: PointGrid, cells: NDArray) -> NDArray:
    """(N, 3) float32 positions of (N, 3) cells."""
    space = _uncontracted(grid.low + cells * grid.cell)
    return np.ascontiguousarray(grid.centre + grid.radius * space, np.float32)


def _contracted(offsets: NDArray) -> NDArray:
    """Coordinates, float of any shape, 1 where the scene's bulk ends, with logarithms beyond."""
    far = np.maximum(np.abs(offsets), 1)
    return np.where(far > 1, np.sign(offsets) * (1 + np.log(far)), offsets)


def _uncontracted(values: NDArray) -> NDArray:
    """Inverse of `_contracted`, float of any shape."""
    far = np.maximum(np.abs(values), 1)
    return np.where(far > 1, np.sign(values) * np.exp(far - 1), values)
