"""The transform graphs against their torch twins and against float64: ordinary and extreme inputs."""

import numpy as np
import pytest
import torch
from reference import transforms as reference
from reference.transforms import project_view
from scenes import make_smooth_gaussians

from tinysplat import transforms as T
from tinysplat_runtime.codec.analysis import coefficient_moment, color_planes
from tinysplat_runtime.codec.basis import (
    mean_magnitude_weighting,
    reduce_basis,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats
from tinysplat_runtime.graphs.inference import CONTRACTS, GraphStore

STORE = GraphStore(threads=1)

SIZES = [(1, 1, 1), (2, 7, 5), (3, 16, 24)]


def _camera_inputs(cameras, invert: bool) -> dict[str, np.ndarray]:
    rotations = np.stack([c.rotation.T if invert else c.rotation for c in cameras])
    return {
        "K": np.float32([c.K for c in cameras]),
        "rotation": np.float32(rotations),
        "rotation_quat": np.float32(matrices_to_quats(rotations)),
    }


def _vpt_inputs(g: Gaussians) -> dict[str, np.ndarray]:
    centres = np.stack([c.centre for c in g.cameras]) - g.origin
    high = np.float32(centres)
    arrays = {name: getattr(g, name) for name in ("means", "quats", "scales", "opacities")}
    return {**arrays, **_camera_inputs(g.cameras, False), "centre_high": high, "centre_low": np.float32(centres - high)}


def _synthesis_inputs(geometry: np.ndarray, cameras, origin, limits=(1e-6, 1e9)) -> dict[str, np.ndarray]:
    """Real-valued planes through the integer graph: with one pixel per run, the plane of ones can carry any value."""
    views = len(cameras)
    return {
        "geometry_codes": np.ones((views, 1, 1, 1), np.uint16),
        "geometry_mix": np.float32(geometry)[..., None],
        "color_codes": np.ones((views, 1, 1, 1), np.uint16),
        "color_mix": np.zeros((1, 12), np.float32),
        **_camera_inputs(cameras, True),
        "centre": np.float32([c.centre - origin for c in cameras]),
        "inverse_depth": np.array(0, np.float32),
        "relative_rotation": np.array(0, np.float32),
        "depth_limits": np.float32(limits),
    }


@pytest.mark.parametrize("size", SIZES)
def test_vpt_graph_matches_its_torch_twin_and_float64(size):
    g = make_smooth_gaussians(*size)
    inputs = _vpt_inputs(g)
    found = STORE.transform("analysis_vpt").run(inputs)
    twin = T.ViewProjection()(*(torch.from_numpy(inputs[n]) for n in CONTRACTS["analysis_vpt"].inputs))
    np.testing.assert_allclose(found["geometry"], twin[0].numpy(), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(found["rotation_moment"], twin[1].numpy(), rtol=1e-5, atol=1e-5)
    wanted = np.stack([project_view(g, v) for v in range(size[0])])
    # Pixel offsets are differences of numbers as large as the image: 1e-5 px is an ulp of a few hundred.
    np.testing.assert_allclose(found["geometry"], wanted, rtol=1e-5, atol=3e-5)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
@pytest.mark.parametrize("weighting", [mean_magnitude_weighting, second_moment_weighting])
def test_vabr_round_trip_with_all_components_is_within_1e_5(degree, weighting):
    g = make_smooth_gaussians(2, 16, 12, degree)
    moment = coefficient_moment(STORE, g)
    delta = weighting(view_directions(g.cameras), degree)
    reduction = reduce_basis(weighted_spectrum(moment, delta), delta, len(moment))
    planes = color_planes(STORE, g, reduction.projection)
    back = np.einsum("vkhw,dk->vhwd", planes.astype(np.float64), reduction.inverse.astype(np.float64))
    error = np.abs(back.reshape(g.sh.shape) - g.sh).max() / np.abs(g.sh).max()
    assert error <= 1e-5


def test_moment_and_projection_match_float64():
    g = make_smooth_gaussians(3, 20, 17, 4)
    wanted = reference.coefficient_moment(g.sh)
    np.testing.assert_allclose(coefficient_moment(STORE, g), wanted, atol=1e-6 * np.abs(wanted).max())
    projection = np.random.default_rng(0).standard_normal((75, 6))
    planes = reference.project_coefficients(g.sh, projection)
    np.testing.assert_allclose(color_planes(STORE, g, projection), planes, atol=2e-6 * np.abs(planes).max())


@pytest.mark.parametrize("forms", [(0.0, 0.0), (1.0, 1.0)])
def test_synthesis_graph_matches_its_torch_twin_and_float64(forms):
    rng = np.random.default_rng(1)
    g = make_smooth_gaussians(2, 9, 11, 1)
    planes, k, d = 12, 5, 12
    mix = rng.uniform(-1e-4, 1e-4, (2, 11, planes + 1))
    mix[..., -1] = rng.uniform(0.3, 0.5, (2, 11))
    if forms[0]:
        mix[:, 0, -1] *= -1
    color_mix = rng.uniform(-1e-3, 1e-3, (k + 1, d))
    inputs = {
        "geometry_codes": rng.integers(0, 4096, (2, planes + 1, 9, 11)).astype(np.uint16),
        "geometry_mix": np.float32(mix),
        "color_codes": rng.integers(0, 4096, (2, k + 1, 9, 11)).astype(np.uint16),
        "color_mix": np.float32(color_mix),
        **_camera_inputs(g.cameras, True),
        "centre": np.float32([c.centre for c in g.cameras]),
        "inverse_depth": np.array(forms[0], np.float32),
        "relative_rotation": np.array(forms[1], np.float32),
        "depth_limits": np.float32([0.2, 8.0]),
    }
    inputs["geometry_codes"][:, -1] = inputs["color_codes"][:, -1] = 1
    found = STORE.transform("synthesis").run(inputs)
    twin = T.Synthesis()(*(torch.from_numpy(inputs[n]) for n in CONTRACTS["synthesis"].inputs))
    for want, key in zip(twin, CONTRACTS["synthesis"].outputs, strict=True):
        np.testing.assert_allclose(found[key], want.numpy(), rtol=1e-5, atol=1e-6, err_msg=key)

    wanted = reference.synthesise(inputs, g.cameras, np.zeros(3))
    for key, want in wanted.items():
        np.testing.assert_allclose(found[key], want, rtol=1e-5, atol=2e-5, err_msg=key)


def test_a_rotation_that_noise_made_zero_becomes_the_identity():
    g = make_smooth_gaussians(1, 1, 1, 0)
    geometry = np.zeros((1, 11), np.float32)
    geometry[:, 0] = 2
    inputs = _synthesis_inputs(geometry, g.cameras, g.origin)
    found = STORE.transform("synthesis").run(inputs)["quats"][0, 0, 0]
    np.testing.assert_allclose(found, inputs["rotation_quat"][0], atol=1e-6)
