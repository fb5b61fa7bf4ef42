"""Points along a Morton curve, by interleaving bits one at a time."""

from __future__ import annotations

import numpy as np

from tinysplat_runtime.gaussian.curve import gathered, morton_order, spread

BITS = 21


def interleaved(cells: np.ndarray) -> list[int]:
    """Bit k of x, y and z at 3k, 3k + 1 and 3k + 2."""
    keys = []
    for cell in cells.astype(int).tolist():
        keys.append(sum(((n >> k) & 1) << (3 * k + axis) for axis, n in enumerate(cell) for k in range(BITS)))
    return keys


def test_bits_are_spread_to_every_third_place_and_gathered_again() -> None:
    values = np.concatenate([1 << np.arange(BITS), [0, 2**BITS - 1], np.random.default_rng(0).integers(0, 2**BITS, 99)])
    found = spread(values.astype(np.uint64))
    zero = np.zeros_like(values)
    assert found.tolist() == interleaved(np.stack([values, zero, zero], axis=1))
    others = np.uint64(2**63 - 1) & ~spread(np.array([2**BITS - 1], np.uint64))
    np.testing.assert_array_equal(gathered(found), values)
    np.testing.assert_array_equal(gathered(found | others), values)  # what lies between says nothing


def test_points_are_ordered_by_the_cells_of_their_box() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-3, 5, (400, 3)) * [1, 100, 0.01] + [7, 0, -2]
    low, high = points.min(axis=0), points.max(axis=0)
    keys = interleaved((points - low) / (high - low) * (2**BITS - 1))
    np.testing.assert_array_equal(morton_order(points), sorted(range(400), key=keys.__getitem__))


def test_a_flat_box_and_equal_points_keep_their_order() -> None:
    points = np.array([[1.0, 5, 2], [0, 5, 2], [1, 5, 2], [0, 5, 0], [1, 5, 0]])
    assert morton_order(points).tolist() == [3, 4, 1, 0, 2]  # z before x, as its bits lie higher
    assert morton_order(np.zeros((3, 3))).tolist() == [0, 1, 2]
