"""Lists as their files will hold them, without files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import make_list

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.list.coding.rounding import Rounding
from tinysplat_runtime.list.views import views_of

QP = 3.0


@pytest.fixture(scope="module")
def ball() -> Gaussians:
    return make_list(500, 1, np.random.default_rng(1))


@pytest.fixture(scope="module")
def rounding(ball: Gaussians) -> Rounding:
    return Rounding.of(ball, views_of(ball), threads=1)


def sorted_rows(values: NDArray) -> NDArray:
    return values[np.lexsort(values.T)]


def test_positions_are_those_of_the_file(ball, rounding):
    decoded = ts.decompress(ts.compress(ball, qp=QP, keep_all=True))
    np.testing.assert_array_equal(sorted_rows(rounding.rounded(ball, QP).means), sorted_rows(decoded.means))


def test_a_lattice_rounds_what_it_was_made_of_as_the_list_is_rounded(ball, rounding):
    lattice = rounding.lattice(ball, QP)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(lattice.rounded(ball), name), getattr(rounding.rounded(ball, QP), name))


@pytest.mark.parametrize("finer", [1.0, 0.25])
def test_what_moved_is_rounded_by_less_than_a_step(ball, rounding, finer):
    lattice, rng = rounding.times(finer).lattice(ball, QP), np.random.default_rng(2)
    moved = replace(
        ball,
        means=ball.means + rng.normal(0, 0.02, ball.means.shape).astype(np.float32),
        opacities=np.clip(ball.opacities + rng.normal(0, 0.05, ball.count), 0.01, 1).astype(np.float32),
    )
    found, steps = lattice.rounded(moved), lattice.steps
    roots = np.abs(np.sqrt(found.opacities) - np.sqrt(moved.opacities))
    assert (roots < steps[PlaneClass.OPACITY, 0] + 1e-6).all()
    for axis in range(3):
        assert (np.abs(found.means - moved.means)[:, axis] < steps[PlaneClass.POSITION, axis]).all()
    assert roots.max() > 0.2 * steps[PlaneClass.OPACITY, 0].min()
