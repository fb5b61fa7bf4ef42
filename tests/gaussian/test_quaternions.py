"""What files keep of quaternions, and quaternions whose components lie along another axis."""

from __future__ import annotations

import numpy as np

from tinysplat_runtime.gaussian.quaternions import from_smallest_three, smallest_three

HAND = np.array([[0.9, -0.1, 0.3, 0.3], [0.1, -0.9, 0.3, -0.3], [0.3, 0.1, 0.9, -0.3], [0.1, 0.3, -0.3, -0.9]])
THREE = [[-0.1, 0.3, 0.3], [-0.1, -0.3, 0.3], [0.3, 0.1, -0.3], [-0.1, -0.3, 0.3]]


def test_three_components_are_kept_in_order_beside_the_largest_which_is_positive() -> None:
    largest, three = smallest_three(HAND)
    assert largest.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(three, THREE)
    signs = np.array([1, -1, 1, -1])[:, None]
    np.testing.assert_allclose(from_smallest_three(largest, three), signs * HAND, atol=1e-15)


def test_three_that_are_longer_than_1_leave_the_largest_nothing() -> None:
    found = from_smallest_three(np.array([2, 0]), np.array([[0.8, 0.8, 0.1], [0.6, 0.0, 0.8]]))
    np.testing.assert_allclose(found, [[0.8, 0.8, 0, 0.1], [0, 0.6, 0, 0.8]], atol=1e-7)
