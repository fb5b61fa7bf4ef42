"""Lists as their files will hold them, without files."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import make_list

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import Gaussians
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
