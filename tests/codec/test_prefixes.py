"""Prefixes of a file: what they decode to, and what stands in for planes that are not there."""

import numpy as np
import pytest
from scenes import drawn_psnr, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(2, 40, 48, degree=2, layers=2)


@pytest.fixture(scope="module", params=["paper", "balanced"])
def data(request, gaussians):
    return ts.compress(gaussians, profile=request.param, qp=-6)


def _ends(data: bytes) -> list[int]:
    return [prefix["bytes"] for prefix in ts.inspect(data)["prefixes"]]


def test_every_listed_prefix_is_nearer_to_the_whole_than_the_one_before(data):
    whole = ts.decompress(data)
    shown = [drawn_psnr(whole, ts.decompress(data, max_bytes=end)) for end in _ends(data)[:-1]]
    assert shown[-1] > shown[0] and (np.diff(shown) > -0.1).all(), shown  # noise: its second layer shows nothing


def test_a_view_without_depth_is_hidden_and_the_other_is_not(data):
    end = read_container(data).body.layers[0].channels[0].pictures[0].end
    decoded = ts.decompress(data, max_bytes=end)
    assert decoded.opacities[0].min() > 0
    assert (decoded.opacities[1] == 0).all()
    assert all((layer.opacities == 0).all() for layer in decoded.extra_layers)
    with pytest.raises(FormatError, match=str(end)):
        ts.decompress(data, max_bytes=end - 1)
