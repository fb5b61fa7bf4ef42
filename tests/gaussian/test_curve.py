"""Points along a Morton curve, by interleaving bits one at a time."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import agree

from tinysplat_runtime.gaussian.curve import gathered, morton_order, spread

BITS = 21
CELLS = arrays(np.uint64, st.integers(1, 40), elements=st.integers(0, 2**BITS - 1))
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


def test_bits_are_spread_to_every_third_place_and_gathered_again() -> None:
    def wanted(cells: np.ndarray) -> list[int]:
        return interleaved(np.stack([cells, 0 * cells, 0 * cells], axis=1))

    agree(lambda cells: spread(cells).astype(float), lambda cells: np.array(wanted(cells), float), CELLS)
    others = np.uint64(2**63 - 1) & ~spread(np.array([2**BITS - 1], np.uint64))  # what lies between says nothing
    agree(lambda cells: gathered(spread(cells) | others), lambda cells: cells, CELLS)


def test_points_are_ordered_by_the_cells_of_their_box() -> None:
    agree(morton_order, by_keys, POINTS)
    rng = np.random.default_rng(1)
    points = rng.uniform(-3, 5, (400, 3)) * [1, 100, 0.01] + [7, 0, -2]
    np.testing.assert_array_equal(morton_order(points), by_keys(points))
