"""Laws of the whole chain over random shapes, cameras, degrees and profiles."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.profiles import PROFILES

GRIDS = st.tuples(st.integers(1, 4), st.integers(1, 40), st.integers(1, 40))
PROFILE = st.sampled_from(sorted(PROFILES))


@given(grid=GRIDS, degree=st.integers(0, 4), layers=st.integers(1, 3), profile=PROFILE, seed=st.integers(0, 99))
def test_any_grid_comes_back_with_its_shape_cameras_and_bounded_error(grid, degree, layers, profile, seed):
    g = make_smooth_gaussians(*grid, degree, seed=seed, layers=layers)
    decoded = ts.decompress(ts.compress(g, profile))
    assert [layer.opacities.shape for layer in decoded.layers] == [layer.opacities.shape for layer in g.layers]
    for found, camera in zip(decoded.cameras, g.cameras, strict=True):
        np.testing.assert_array_equal(found.c2w, camera.c2w)
        np.testing.assert_array_equal(found.K, camera.K)
    for layer, wanted in zip(decoded.layers, g.layers, strict=True):
        for name in ("means", "quats", "scales", "opacities", "sh"):
            assert np.isfinite(getattr(layer, name)).all(), name
        np.testing.assert_allclose(np.linalg.norm(layer.quats, axis=-1), 1, atol=1e-5)
        assert layer.opacities.min() >= 0 and layer.opacities.max() <= 1 and layer.scales.min() >= 0
        # Depths between 2 and 4 move by far less than their spread; offsets by less than a pixel's footprint or two.
        error = np.linalg.norm(layer.means - wanted.means, axis=-1)
        footprint = 4 / min(camera.focal for camera in wanted.cameras)
        assert np.sqrt((error**2).mean()) <= 0.2 + footprint


@given(degree=st.integers(0, 2), profile=PROFILE, seed=st.integers(0, 20))
@settings(max_examples=12)
def test_a_finer_qp_costs_more_bytes_and_loses_less(degree, profile, seed):
    g = make_smooth_gaussians(2, 32, 40, degree, seed=seed)
    sizes, errors = [], []
    for qp in (-6, 6, 18):
        data = ts.compress(g, profile, qp)
        sizes.append(len(data))
        errors.append(float(np.mean((ts.decompress(data).means - g.means) ** 2)))
    assert sizes[0] > sizes[1] > sizes[2]
    assert errors[0] < errors[2]


@given(seed=st.integers(0, 50), profile=PROFILE)
@settings(max_examples=8)
def test_coding_is_a_function_of_its_input(seed, profile):
    g = make_smooth_gaussians(2, 17, 23, 1, seed=seed)
    one, four = ts.Runtime(threads=1), ts.Runtime(threads=4)
    data = one.compress(g, profile)
    assert data == four.compress(g, profile) == one.compress(g, profile)
    np.testing.assert_array_equal(one.decompress(data).means, four.decompress(data).means)


@given(shift=st.tuples(*[st.floats(-1e6, 1e6)] * 3), seed=st.integers(0, 20))
@settings(max_examples=15)
def test_a_scene_far_from_the_origin_codes_like_one_at_the_origin(shift, seed):
    near, far = (
        make_smooth_gaussians(1, 16, 20, 0, seed=seed),
        make_smooth_gaussians(1, 16, 20, 0, seed=seed, origin=np.array(shift)),
    )
    a, b = ts.decompress(ts.compress(near)), ts.decompress(ts.compress(far))
    np.testing.assert_array_equal(b.origin, np.array(shift))
    np.testing.assert_allclose(b.means, a.means, atol=2e-3)


@given(views=st.integers(2, 6), seed=st.integers(0, 9))
@settings(max_examples=6)
def test_permuting_views_permutes_the_decoded_views(views, seed):
    g = make_smooth_gaussians(views, 16, 24, 1, seed=seed)
    order = np.random.default_rng(seed).permutation(views)
    shuffled = ts.Gaussians(
        **{name: getattr(g, name)[order] for name in ("means", "quats", "scales", "opacities", "sh")},
        cameras=tuple(g.cameras[i] for i in order),
    )
    a, b = ts.decompress(ts.compress(g, "paper")), ts.decompress(ts.compress(shuffled, "paper"))
    np.testing.assert_allclose(b.means, a.means[order], atol=1e-3)
    np.testing.assert_allclose(b.opacities, a.opacities[order], atol=0.02)
