"""The container: what is written comes back, and what was tampered with is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_smooth_gaussians, refusing
from sections import sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.notes import Notes


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(2, 17, 22, degree=1, layers=2)


@pytest.fixture(scope="module", params=["paper", "balanced"])
def data(request, gaussians):
    return ts.compress(gaussians, profile=request.param)


def test_metadata_comes_back_exactly(gaussians, data):
    container = read_container(data)
    assert len(container.cameras) == 2 and len(container.body.layers) == 2
    for found, camera in zip(container.cameras, gaussians.cameras, strict=True):
        np.testing.assert_array_equal(found.K, camera.K)
        np.testing.assert_array_equal(found.c2w, camera.c2w)
    coarse = gaussians.extra_layers[0]
    assert (container.body.layers[1].height, container.body.layers[1].width) == coarse.opacities.shape[1:]
    np.testing.assert_array_equal(container.body.layers[1].cameras[1].K, coarse.cameras[1].K)


def test_readers_may_skip_notes(gaussians):
    data = ts.compress(gaussians.with_notes(Notes(unit="metre", refined="20 steps")), profile="paper")
    assert {kind for kind, flags, *_ in sections_of(data) if not flags & L.REQUIRED} == {b"NOTE"}


def test_a_prefix_that_ends_with_the_table_is_told_what_the_metadata_takes(data):
    sections = sections_of(data)
    end = L.HEADER.size + len(sections) * L.TABLE_ROW.size
    metadata = len(data) - len(sections[-1][3])
    with refusing(FormatError, f"{end} {metadata}"):
        read_container(data[:end], is_prefix=True)
    with refusing(FormatError, f"{len(sections)} {end - 1}"):
        read_container(data[: end - 1], is_prefix=True)
    assert read_container(data[:metadata], is_prefix=True).total_bytes == len(data)
    with refusing(FormatError, f"{metadata - 1} {metadata}"):
        read_container(data[: metadata - 1], is_prefix=True)
