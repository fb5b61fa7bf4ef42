"""Points along a Morton curve, by interleaving bits one at a time."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import agree

from tinysplat_runtime.gaussian.curve import cells_of, morton_keys, morton_order

BITS = 21
CELLS = arrays(np.int64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.integers(0, 2**BITS - 1))
POINTS = arrays(np.float64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.sampled_from([-3.0, 0, 1e-9, 1, 5]))


def interleaved(cells: np.ndarray) -> list[int]:
    """Bit k of x, y and z at 3k, 3k + 1 and 3k + 2."""
    keys = []
    for cell in cells.astype(int).tolist():
        keys.append(sum(((n >> k) & 1) << (3 * k + axis) for axis, n in enumerate(cell) for k in range(BITS)))
    return keys


def by_keys(points: np.ndarray) -> list[int]:
    """Rows in the order of their cells' keys; equal ones keep their order."""
    low, span = points.min(axis=0), np.ptp(points, axis=0)
    keys = interleaved((points - low) / np.where(span > 0, span, 1) * (2**BITS - 1))
    return sorted(range(len(points)), key=keys.__getitem__)


def test_bits_of_cells_are_interleaved_and_taken_apart_again() -> None:
    agree(lambda cells: morton_keys(cells).astype(float), lambda cells: np.array(interleaved(cells), float), CELLS)
    agree(lambda cells: cells_of(morton_keys(cells)), lambda cells: cells.astype(float), CELLS)


def test_points_are_ordered_by_the_cells_of_their_box() -> None:
    agree(morton_order, by_keys, POINTS)
    rng = np.random.default_rng(1)
    points = rng.uniform(-3, 5, (400, 3)) * [1, 100, 0.01] + [7, 0, -2]
    np.testing.assert_array_equal(morton_order(points), by_keys(points))
