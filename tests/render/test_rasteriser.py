"""Both rasterisers, numpy's and the compiled one, draw what the float64 per-pixel reference draws.

Tolerance: 1e-4. Where rounding decides a threshold or an order of depths, at most 0.1 % of the pixels (or one) may
differ by one alpha step, 1/255, more.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from reference.rasteriser import render_reference
from scenes import make_cameras, make_gaussians, photographed

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera

ATOL = 1e-4
ATOL_ROUNDING = 1 / 255 + ATOL
ROUNDING_SHARE = 1e-3

OUTPUTS = ("rgb", "depth", "alpha")


def check(found: NDArray, expected: NDArray, scale: float = 1.0) -> None:
    """`found` is `expected` up to the tolerance, relative to `scale`."""
    assert found.dtype == np.float32
    error = (np.abs(found - expected) / scale).reshape(*expected.shape[:2], -1).max(axis=-1)
    assert error.max() <= ATOL_ROUNDING
    assert np.count_nonzero(error > ATOL) <= max(1, ROUNDING_SHARE * error.size)


def agree(
    gaussians: Gaussians, camera: Camera, drawing: Any = DEFINITION, background: tuple[float, ...] = (0.2, 0.7, 0.1)
) -> None:
    """Both rasterisers draw what the reference draws: colours, coverage, and depth where coverage is the same."""
    expected = render_reference(gaussians, camera, background, **drawing)
    for compiled in (False, True):
        renderer = Renderer(gaussians, threads=1, compiled=compiled, **drawing)
        found = renderer.render(camera, background=background, outputs=OUTPUTS)
        check(found["rgb"], np.clip(expected["rgb"], 0, 1))
        check(found["alpha"], expected["alpha"])
        steady = np.abs(found["alpha"] - expected["alpha"]) < ATOL * np.maximum(expected["alpha"], 0.1)
        depths = (np.where(steady, image["depth"], 0) for image in (found, expected))
        check(*depths, scale=max(expected["depth"].max(), 1e-6))


# ---- random scenes, at the edges more often than not ---------------------------------------------------------------


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """Pictures of a pixel, a row or no multiple of a tile; principal points anywhere, skew, turned."""
    width, height = draw(st.sampled_from([(1, 1), (4096, 1), (1, 4096), (32, 24), (37, 30), (5, 60)]))
    focal = max(width, height) * draw(st.sampled_from([0.6, 1.0, 4.0]))
    aside = draw(st.sampled_from([(0.5, 0.5), (0.1, 1.2), (-0.8, -0.4)]))
    skew = draw(st.sampled_from([0.0, 0.2])) * focal
    c2w = np.eye(4)
    if draw(st.booleans()):
        c2w[:3, :3] = quats_to_matrices(normalize_quats(np.array([1, 0.15, -0.2, 0.1])))
        c2w[:3, 3] = -0.3, 0.2, -0.4
    return Camera([[focal, skew, aside[0] * width], [0, 0.9 * focal, aside[1] * height], [0, 0, 1]], c2w, width, height)


@st.composite
def clouds(draw: st.DrawFn) -> Gaussians:
    """One Gaussian or many: behind, beside, around or before the camera, from points to larger than the picture, as
    needles, discs and balls, opaque or hardly there, at equal depths."""
    count = draw(st.sampled_from([1, 2, 9, 60, 200]))
    rng = np.random.default_rng(draw(st.integers(0, 1 << 16)))
    where = draw(st.sampled_from(["before", "around", "inside", "beyond the frame", "on the near plane", "one depth"]))
    means = rng.normal(size=(count, 3)) * {"beyond the frame": (8, 8, 1), "inside": 0.2}.get(where, (1, 1, 0.6))
    if where in ("before", "beyond the frame"):
        means += (0, 0, 3)
    elif where == "on the near plane":
        means = means * (0.01, 0.01, 0) + np.linspace(-0.01, 0.03, count)[:, None] * (0, 0, 1)
    elif where == "one depth":
        means = means * (1, 1, 0) + (0, 0, 2)
    size = draw(st.sampled_from([0.0, 1e-5, 0.03, 0.5, 40.0]))
    stretch = draw(st.sampled_from([(1, 1, 1), (60, 1, 0.1), (20, 20, 0)]))
    opacity = draw(st.sampled_from([None, 1.0, float(np.nextafter(np.float32(1), np.float32(0))), 0.5, 0.006]))
    degree = draw(st.integers(0, 4))
    return Gaussians(
        means=means,
        quats=rng.normal(size=(count, 4)),
        scales=size * np.exp(0.6 * rng.normal(size=(count, 3))) * stretch,
        opacities=np.full(count, opacity) if opacity is not None else rng.uniform(size=count) ** 0.5,
        sh=0.3 * rng.normal(size=(count, (degree + 1) ** 2, 3)),
    )


@settings(max_examples=100)
@given(clouds(), cameras())
def test_clouds_are_drawn_as_they_are_defined(gaussians: Gaussians, camera: Camera) -> None:
    agree(gaussians, camera)


@settings(max_examples=100)
@given(photographed())
def test_photos_gaussians_are_drawn_as_they_are_defined(made: tuple[Gaussians, Camera, dict[str, str]]) -> None:
    agree(*made)


# ---- scenes that stay ----------------------------------------------------------------------------------------------


def cloud(count, size=0.04):
    """Random Gaussians before the camera, `size` scene units wide."""
    rng = np.random.default_rng(0)
    return Gaussians(
        means=rng.normal(size=(count, 3)) * (1, 1, 0.6) + (0, 0, 3),
        quats=rng.normal(size=(count, 4)),
        scales=size * np.exp(0.6 * rng.normal(size=(count, 3))),
        opacities=rng.uniform(size=count) ** 0.5,
        sh=0.3 * rng.normal(size=(count, 4, 3)),
    )


def pinhole():
    return Camera([[60, 0, 32], [0, 55, 24], [0, 0, 1]], np.eye(4), 64, 48)


def per_pixel():
    return make_gaussians(views=2, height=24, width=32, degree=3, layers=2)


def test_gaussians_from_very_near_agree_with_the_reference():
    """Own pixels of hundreds of the screen's, wider than float32 projects, and others behind their own views."""
    gaussians = make_gaussians(views=2, height=6, width=8, degree=1, seed=6)
    ahead = gaussians.cameras[0].c2w.copy()
    ahead[:3, 3] += gaussians.means[0, 2, 3] * 0.98
    camera = Camera(gaussians.cameras[0].K * [[8], [8], [1]], ahead, 64, 48)
    for scene in (gaussians, replace(gaussians, means=-gaussians.means)):
        expected = render_reference(scene, camera, dilation="own")
        for compiled in (False, True):
            found = Renderer(scene, 1, compiled=compiled, dilation="own", order="depth").render(camera)
            check(found, np.clip(expected["rgb"], 0, 1))


@pytest.mark.parametrize("views", [7, 20])
def test_of_many_views_near_ones_are_drawn(views):
    gaussians = make_gaussians(views, height=6, width=8, degree=1, layers=2)
    gaussians = replace(gaussians, opacities=0.5 * gaussians.opacities)  # so that what lies behind shows
    seen = gaussians.cameras[views // 2].resized(18, 24)
    aside = np.eye(4)
    aside[:3, 3] = 0.03, 0.02, 0.01  # as far from no two views
    agree(gaussians, Camera(seen.K, seen.c2w @ aside, 24, 18), {"dilation": "own", "order": "near"})


def test_pictures_far_from_the_world_origin_agree_with_those_near_it():
    gaussians = per_pixel()
    near = make_cameras(1, 24, 32)[0]
    place = np.array([6.4e6, -3.1e6, 1.2e6])  # metres from the earth's centre
    c2w = near.c2w.copy()
    c2w[:3, 3] += place
    moved = Gaussians(**{**vars(gaussians.flat()), "origin": place})
    expected = render_reference(gaussians, near)
    for compiled in (False, True):
        renderer = Renderer(moved, 1, compiled=compiled, **DEFINITION)
        found = renderer.render(Camera(near.K, c2w, near.width, near.height), outputs=OUTPUTS)
        check(found["rgb"], np.clip(expected["rgb"], 0, 1))
        check(found["depth"], expected["depth"], scale=expected["depth"].max())


@pytest.mark.parametrize("focal", [8, 40])
def test_points_beside_the_picture_reach_into_it_by_their_own_pixels(focal):
    """Of no size themselves: their photo's pixel, enlarged, alone brings them in."""
    gaussians = make_gaussians(views=2, height=6, width=8, degree=1, seed=6)
    gaussians = replace(gaussians, scales=1e-5 * gaussians.scales, opacities=0.5 + 0.5 * gaussians.opacities)
    first = gaussians.cameras[0]
    K = first.K * [[focal], [focal], [1]]
    at = K @ first.rotation @ (gaussians.means[0, 2, 3] - first.centre)
    K[:2, 2] -= at[:2] / at[2] - (12 + 0.6 * focal, 8)  # 0.6 of its pixel beyond the right border
    agree(gaussians, Camera(K, first.c2w, 12, 16), {"dilation": "own", "order": "depth"})


@pytest.mark.parametrize("compiled", [False, True], ids=["numpy", "compiled"])
def test_what_lies_out_of_sight_changes_no_picture(compiled):
    """Tens of thousands behind the camera and beside it, in as many parts as a renderer likes."""
    seen, rng = cloud(500), np.random.default_rng(0)
    aside = rng.uniform(-1, 1, (40_000, 3)) + np.array([0, 0, -4])
    aside[::2] += (60, 0, 9)
    other = cloud(40_000, size=0.02)
    both = Gaussians(
        **{
            name: np.concatenate([aside if name == "means" else getattr(other, name), getattr(seen, name)])
            for name in ("means", "quats", "scales", "opacities", "sh")
        }
    )
    found, wanted = (Renderer(scene, 1, compiled=compiled).render(pinhole()) for scene in (both, seen))
    np.testing.assert_allclose(found, wanted, atol=ATOL)
