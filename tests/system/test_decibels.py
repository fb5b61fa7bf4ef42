"""Decibels by their definition, and the ceiling of pictures that are equal."""

from __future__ import annotations

import pytest

from tinysplat_runtime.system.decibels import decibels


@pytest.mark.parametrize(
    ("squared", "expected"), [(1, 0), (0.01, 20), (10, -10), (1e-14, 140), (1e-15, 150), (1e-16, 150), (0, 150)]
)
def test_decibels_are_ten_times_the_logarithm_up_to_a_ceiling(squared: float, expected: float) -> None:
    assert decibels(squared) == pytest.approx(expected, abs=1e-9)
