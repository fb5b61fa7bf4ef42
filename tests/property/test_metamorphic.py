"""What must not change when the world, the views or the picture's frame do, and what coding again and again costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scenes import drawn_psnr, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import multiply_quats, normalize_quats, quats_to_matrices
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.render import render
from tinysplat_runtime.scene.cameras import Camera

STORE = GraphStore(threads=1)

PLANE_ATOL = 5e-5
"""Pixels, quaternion units, and depths relative to themselves: an ulp of pixel coordinates, a few times over."""

PICTURE_ATOL = 2e-4
"""Of 1; at most one pixel in a hundred may differ by more, where rounding decides an order or a threshold."""

TURN = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 0.1)
SHIFT = st.tuples(*[st.floats(-50, 50)] * 3)


def _moved(g: Gaussians, scale: float, quat: NDArray, shift: NDArray) -> Gaussians:
    """The world scaled, then rotated, then translated, cameras with it; exact for SH of degree 0."""
    q = normalize_quats(np.asarray(quat, np.float64))
    R = quats_to_matrices(q)
    cameras = []
    for camera in g.cameras:
        c2w = camera.c2w.copy()
        c2w[:3, :3] = R @ c2w[:3, :3]
        c2w[:3, 3] = R @ (c2w[:3, 3] * scale) + shift
        cameras.append(Camera(camera.K, c2w, camera.width, camera.height))
    means = (g.means.astype(np.float64) * scale) @ R.T
    quats = multiply_quats(q, normalize_quats(g.quats.astype(np.float64)))
    return Gaussians(means, quats, g.scales * scale, g.opacities, g.sh, tuple(cameras), np.asarray(shift))


def _planes(g: Gaussians, scale: float = 1.0) -> NDArray:
    geometry = project_layer(STORE, g, drop_invalid=False, where="").geometry.astype(np.float64)
    geometry[:, 0] /= scale * 3  # depths lie around 3
    return geometry


def _same_up_to_sign(a: NDArray, b: NDArray) -> None:
    signs = np.sign((a[:, 6:10] * b[:, 6:10]).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(a[:, 6:10] * signs, b[:, 6:10], atol=PLANE_ATOL)
    rest = [*range(6), 10]
    np.testing.assert_allclose(a[:, rest], b[:, rest], atol=PLANE_ATOL, rtol=PLANE_ATOL)


def _same_picture(a: NDArray, b: NDArray) -> None:
    off = np.abs(a - b).max(axis=-1) > PICTURE_ATOL
    assert off.mean() <= 0.01, off.mean()


@given(scale=st.floats(1e-3, 1e3), quat=TURN, shift=SHIFT, seed=st.integers(0, 20))
@settings(max_examples=15)
def test_a_world_scaled_rotated_and_translated_has_the_same_planes_and_pictures(scale, quat, shift, seed) -> None:
    g = make_smooth_gaussians(2, 12, 16, 0, seed=seed)
    moved = _moved(g, scale, np.array(quat), np.array(shift))
    _same_up_to_sign(_planes(moved, scale), _planes(g))
    for a, b in zip(g.cameras, moved.cameras, strict=True):
        _same_picture(render(g, a, near_plane=0.01), render(moved, b, near_plane=0.01 * scale))


@given(views=st.integers(2, 5), degree=st.integers(0, 2), seed=st.integers(0, 20))
@settings(max_examples=10)
def test_permuted_views_give_permuted_planes_and_the_same_picture(views, degree, seed) -> None:
    g = make_smooth_gaussians(views, 10, 14, degree, seed=seed)
    order = np.random.default_rng(seed).permutation(views)
    arrays = {name: getattr(g, name)[order] for name in ("means", "quats", "scales", "opacities", "sh")}
    shuffled = Gaussians(**arrays, cameras=tuple(g.cameras[i] for i in order))
    np.testing.assert_array_equal(_planes(shuffled), _planes(g)[order])
    _same_picture(render(shuffled, g.cameras[0]), render(g, g.cameras[0]))


@given(top=st.integers(0, 6), left=st.integers(0, 8), height=st.integers(1, 8), width=st.integers(1, 8))
@settings(max_examples=15)
def test_cropping_gives_the_crop_of_planes_and_pictures(top, left, height, width) -> None:
    g = make_smooth_gaussians(1, 16, 20, 1, seed=3)
    camera = g.cameras[0]
    K = camera.K.copy()
    K[:2, 2] -= (left, top)
    cropped_camera = Camera(K, camera.c2w, width, height)
    rows, columns = slice(top, top + height), slice(left, left + width)
    arrays = {n: getattr(g, n)[:, rows, columns] for n in ("means", "quats", "scales", "opacities", "sh")}
    cropped = Gaussians(**arrays, cameras=(cropped_camera,))
    _same_up_to_sign(_planes(cropped), _planes(g)[:, :, rows, columns])
    _same_picture(render(g, cropped_camera), render(g, camera)[rows, columns])


# ---- quality --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["paper", "fast", "balanced", "max"])
def test_quality_falls_with_every_six_steps_of_qp(profile) -> None:
    g = make_smooth_gaussians(2, 40, 56, 1)
    files = [ts.compress(g, profile, qp) for qp in range(-9, 22, 6)]
    quality = [drawn_psnr(ts.decompress(file), g) for file in files]
    assert (np.diff([len(file) for file in files]) < 0).all()
    assert (np.diff(quality) <= 0.05).all(), quality  # the paper's k = 6 caps it: finer steps gain nothing there
    assert quality[0] - quality[-1] > 5


def _fainter(g: Gaussians, rows: slice) -> Gaussians:
    """Some rows of the first view at half their opacity."""
    opacities = g.opacities.copy()
    opacities[0, rows] *= 0.5
    return replace(g, opacities=opacities)


@pytest.mark.parametrize("profile", ["paper", "fast", "balanced"])
def test_generations_edited_in_between_lose_little_beside_the_edits(profile) -> None:
    raw = make_smooth_gaussians(2, 64, 80, 1)
    data = ts.compress(raw, profile)
    uncoded = ts.decompress(data)
    for n in range(4):
        rows = slice(8 * n, 8 * n + 8)
        raw, uncoded = _fainter(raw, rows), _fainter(uncoded, rows)
        data = ts.compress(_fainter(ts.decompress(data), rows), like=data)
        # Pictures of one class and view are coded anew each time, which is no fixed point: docs/NUMERICS.md.
        assert drawn_psnr(uncoded, raw) - drawn_psnr(ts.decompress(data), raw) <= 0.35 * (n + 1)
