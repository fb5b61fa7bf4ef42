"""Prefixes of a file: what they decode to, and what stands in for planes that are not there."""

from __future__ import annotations

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


def test_absent_opacity_is_the_mean_and_absent_depth_refinement_adds_nothing(gaussians):
    data = ts.compress(gaussians, qp=-20)
    prefixes = ts.inspect(data)["prefixes"]
    # Where depth has two records, the first alone is within a few coarse steps of both.
    names = [name for p in prefixes if p["layer"] == 0 for name in p["adds"]]
    assert names.count("depth0") == 2
    end = next(p["bytes"] for p in prefixes if "color0" in p["adds"])
    decoded, whole = ts.decompress(data, max_bytes=end), ts.decompress(data)
    assert np.ptp(decoded.opacities) == 0
    assert decoded.opacities[0, 0, 0] == pytest.approx(gaussians.opacities.mean(), abs=0.05)
    np.testing.assert_allclose(decoded.means, whole.means, atol=0.05)
