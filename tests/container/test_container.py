"""The container: what is written comes back, and what was tampered with is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_smooth_gaussians
from sections import file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.notes import note_sections
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


def test_metadata_stands_before_planes_and_planes_in_the_order_a_picture_needs(data):
    kinds = [kind for kind, *_ in sections_of(data)]
    first = kinds.index(L.PLANES[0])
    assert set(kinds[:first]) == {L.SCENE, L.CAMERAS, L.LAYER, L.PARAMETER_SETS}
    order = [list(L.PLANES.values()).index(kind) for kind, _, index, _ in sections_of(data)[first:] if index == 0]
    assert order == sorted(order)


def test_readers_may_skip_notes():
    found = note_sections(Notes(unit="metre", refined="20 steps"))
    assert [(s.kind, s.minor, s.is_required) for s in found] == [(b"NOTE", 1, False), (b"REFI", 2, False)]


def test_a_prefix_that_ends_with_the_table_is_told_what_the_metadata_takes(data):
    sections = sections_of(data)
    end = L.HEADER.size + len(sections) * L.TABLE_ROW.size
    metadata = end + sum(len(section[3]) for section in sections if section[0] not in set(L.PLANES.values()))
    with pytest.raises(
        FormatError, match=f"the first {end} bytes hold no picture; the metadata alone takes {metadata}"
    ):
        read_container(data[:end], is_prefix=True)
    with pytest.raises(FormatError, match=f"{len(sections)} sections do not fit in {end - 1} bytes"):
        read_container(data[: end - 1], is_prefix=True)
    assert read_container(data[:metadata], is_prefix=True).total_bytes == len(data)
    with pytest.raises(FormatError, match="hold no picture"):
        read_container(data[: metadata - 1], is_prefix=True)


def test_unknown_optional_sections_are_skipped_and_required_ones_refused(data):
    sections = sections_of(data)
    optional = file_of([*sections, [b"XTRA", 0, 0, b"hello"]])
    assert read_container(optional).total_bytes == len(optional)
    with pytest.raises(FormatError, match="required"):
        read_container(file_of([*sections, [b"NEXT", L.REQUIRED, 0, b""]]))
