"""The tiled rasteriser draws what the float64 per-pixel reference draws.

Tolerance: 1e-4. Where rounding decides a threshold or an order of depths, at most 0.1 % of the pixels may differ by one
alpha step, 1/255, more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from reference.rasteriser import render_reference
from scenes import make_cameras, make_gaussians

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer, between
from tinysplat_runtime.scene.cameras import Camera

ATOL = 1e-4
ATOL_ROUNDING = 1 / 255 + ATOL
ROUNDING_SHARE = 1e-3

OUTPUTS = ("rgb", "depth", "alpha")


def cloud(count=1500, degree=1, seed=0, *, centre=(0, 0, 3), spread=(1, 1, 0.6), size=0.04, stretch=(1, 1, 1)):
    """Random Gaussians about a point, `size` scene units wide, times `stretch` along their axes."""
    rng = np.random.default_rng(seed)
    return Gaussians(
        means=rng.normal(size=(count, 3)) * spread + centre,
        quats=rng.normal(size=(count, 4)),
        scales=size * np.exp(0.6 * rng.normal(size=(count, 3))) * stretch,
        opacities=rng.uniform(size=count) ** 0.5,
        sh=0.3 * rng.normal(size=(count, (degree + 1) ** 2, 3)),
    )


def wall(rows=24, columns=32, opacity=0.6):
    """A grid of Gaussians at one depth: each tie is drawn in index order."""
    y, x = np.mgrid[-1 : 1 : rows * 1j, -1.3 : 1.3 : columns * 1j]
    n = x.size
    rng = np.random.default_rng(1)
    return Gaussians(
        means=np.stack([x.ravel(), y.ravel(), np.full(n, 2.0)], axis=-1),
        quats=np.tile([1.0, 0, 0, 0], (n, 1)),
        scales=np.full((n, 3), 0.1),
        opacities=np.full(n, opacity),
        sh=rng.normal(size=(n, 1, 3)),
    )


def pinhole(width=64, height=48, fx=60.0, fy=55.0, cx=None, cy=None, skew=0.0, c2w=None):
    cx, cy = width / 2 if cx is None else cx, height / 2 if cy is None else cy
    return Camera([[fx, skew, cx], [0, fy, cy], [0, 0, 1]], np.eye(4) if c2w is None else c2w, width, height)


def turned(yaw: float, pitch: float, centre=(0.0, 0, 0)):
    """(4, 4) camera to world."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    c2w = np.eye(4)
    c2w[:3, :3] = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ [[1, 0, 0], [0, cp, -sp], [0, sp, cp]]
    c2w[:3, 3] = centre
    return c2w


def per_pixel():
    return make_gaussians(views=2, height=24, width=32, degree=3, layers=2)


SCENES: dict[str, Callable[[], tuple[Gaussians, Camera]]] = {
    "per-pixel layers from an input view": lambda: (per_pixel(), make_cameras(2, 24, 32)[0]),
    "per-pixel layers from between, larger": lambda: (per_pixel(), make_cameras(1, 24, 32)[0].resized(45, 61)),
    **{f"degree {n}": lambda n=n: (cloud(degree=n, seed=n), pinhole()) for n in range(5)},
    "needles": lambda: (cloud(1000, 1, 5, stretch=(60, 1, 1)), pinhole()),
    "needles seen from far off the axis": lambda: (
        cloud(1000, 1, 6, stretch=(300, 1, 0.1), spread=(3, 3, 1)),
        pinhole(fx=200, fy=190),
    ),
    "discs": lambda: (cloud(1000, 0, 7, stretch=(20, 20, 0)), pinhole()),
    "large": lambda: (cloud(600, 2, 8, size=0.8), pinhole()),
    "larger than any picture": lambda: (cloud(200, 0, 9, size=40.0, stretch=(1, 30, 0.01)), pinhole()),
    "smaller than a pixel": lambda: (cloud(1500, 0, 10, size=1e-5), pinhole()),
    "points": lambda: (cloud(1500, 0, 11, stretch=(0, 0, 0)), pinhole()),
    "all around the camera": lambda: (cloud(1500, 1, 12, centre=(0, 0, 0), spread=(1, 1, 1), size=0.1), pinhole()),
    "camera inside Gaussians": lambda: (cloud(300, 1, 13, centre=(0, 0, 0.1), spread=(0.2,) * 3, size=0.3), pinhole()),
    "beyond the image, Jacobian clamped": lambda: (cloud(600, 1, 14, spread=(8, 8, 1), size=1.0), pinhole(fx=90)),
    "principal point off centre": lambda: (cloud(800, 1, 15, spread=(4, 4, 1), size=0.5), pinhole(cx=9.3, cy=55.1)),
    "principal point outside": lambda: (cloud(800, 1, 16, spread=(4, 4, 1), size=0.3), pinhole(cx=-40.0, cy=-20.0)),
    "skew": lambda: (cloud(1000, 1, 17, spread=(4, 4, 1), size=0.3), pinhole(skew=12.0)),
    "turned": lambda: (cloud(1500, 3, 18, size=0.1), pinhole(c2w=turned(0.3, -0.2, (-0.9, 0.4, -0.5)))),
    "opaque": lambda: (
        Gaussians(**{**vars(cloud(1500, 1, 19, size=0.2)), "opacities": np.ones(1500)}),
        pinhole(),
    ),
    "opaque and large: alphas at their limit": lambda: (
        Gaussians(**{**vars(cloud(400, 1, 24, size=3.0)), "opacities": np.ones(400)}),
        pinhole(),
    ),
    "wall of equal depths": lambda: (wall(), pinhole()),
    "opaque wall of equal depths": lambda: (wall(opacity=1.0), pinhole()),
    "one pixel": lambda: (cloud(1500, 0, 20), pinhole(width=1, height=1, fx=2, fy=2)),
    "one row": lambda: (cloud(300, 0, 21), pinhole(width=4096, height=1, fx=2000, fy=2000)),
    "one column": lambda: (cloud(300, 0, 22), pinhole(width=1, height=4096, fx=2000, fy=2000)),
    "no multiple of a tile": lambda: (cloud(1500, 0, 23), pinhole(width=37, height=30)),
}


def check(found, expected, scale=1.0):
    """`found` is `expected` up to the tolerance, relative to `scale`."""
    assert found.dtype == np.float32
    error = np.abs(found - expected) / scale
    error = error.reshape(*error.shape[:2], -1).max(axis=-1)
    assert error.max() <= ATOL_ROUNDING
    assert np.count_nonzero(error > ATOL) <= ROUNDING_SHARE * error.size


def draw(gaussians, camera, compiled, drawing=DEFINITION, **options):
    return Renderer(gaussians, threads=1, compiled=compiled, **drawing).render(camera, outputs=OUTPUTS, **options)


by_both = pytest.mark.parametrize("compiled", [False, True], ids=["numpy", "compiled"])


@by_both
@pytest.mark.parametrize("name", SCENES)
def test_pictures_agree_with_the_reference(name, compiled):
    gaussians, camera = SCENES[name]()
    background = (0.2, 0.7, 0.1)
    expected = render_reference(gaussians, camera, background)
    found = draw(gaussians, camera, compiled, background=background)
    assert expected["alpha"].max() > 0.05  # there is something to see
    check(found["rgb"], np.clip(expected["rgb"], 0, 1))
    check(found["alpha"], expected["alpha"])
    steady = np.abs(found["alpha"] - expected["alpha"]) < ATOL  # a faint splat more or less may move depth anywhere
    check(np.where(steady, found["depth"], 0), np.where(steady, expected["depth"], 0), scale=expected["depth"].max())


@by_both
@pytest.mark.parametrize("order", ["near", "depth"])
@pytest.mark.parametrize("size", [(7, 9), (24, 32), (75, 101)], ids=["from afar", "as it was", "enlarged"])
@pytest.mark.parametrize("views", [2, 4])
def test_own_pixels_and_near_views_agree_with_the_reference(views, size, order, compiled):
    gaussians = make_gaussians(views=views, height=24, width=32, degree=1, layers=2, seed=5)
    camera = between(make_cameras(views, 24, 32), 6)[1].resized(*size)
    expected = render_reference(gaussians, camera, dilation="own", order=order)
    found = draw(gaussians, camera, compiled, {"dilation": "own", "order": order})
    assert expected["alpha"].max() > 0.05
    check(found["rgb"], np.clip(expected["rgb"], 0, 1))
    check(found["alpha"], expected["alpha"])
    check(found["depth"], expected["depth"], scale=expected["depth"].max())


@by_both
def test_gaussians_from_very_near_agree_with_the_reference(compiled):
    """Own pixels of hundreds of the screen's, wider than float32 projects, and others behind their own views."""
    gaussians = make_gaussians(views=2, height=6, width=8, degree=1, seed=6)
    ahead = gaussians.cameras[0].c2w.copy()
    ahead[:3, 3] += gaussians.means[0, 2, 3] * 0.98
    camera = Camera(gaussians.cameras[0].K * [[8], [8], [1]], ahead, 64, 48)
    turned_away = replace(gaussians, means=-gaussians.means)
    for scene in (gaussians, turned_away):
        expected = render_reference(scene, camera, dilation="own")
        found = draw(scene, camera, compiled, {"dilation": "own", "order": "depth"})
        check(found["rgb"], np.clip(expected["rgb"], 0, 1))


@by_both
def test_pictures_far_from_the_world_origin_agree_with_those_near_it(compiled):
    gaussians = per_pixel()
    near = make_cameras(1, 24, 32)[0]
    place = np.array([6.4e6, -3.1e6, 1.2e6])  # metres from the earth's centre
    c2w = near.c2w.copy()
    c2w[:3, 3] += place
    moved = Gaussians(**{**vars(gaussians.flat()), "origin": place})
    expected = render_reference(gaussians, near)
    found = draw(moved, Camera(near.K, c2w, near.width, near.height), compiled)
    check(found["rgb"], np.clip(expected["rgb"], 0, 1))
    check(found["depth"], expected["depth"], scale=expected["depth"].max())


def test_compiled_code_draws_the_same_pictures():
    """To 1e-5, far below what either may differ from the reference, but for the pixels where rounding decides."""
    gaussians = per_pixel()
    camera = make_cameras(3, 24, 32)[1].resized(61, 83)
    by_numpy, by_compiled = (draw(gaussians, camera, compiled) for compiled in (False, True))
    for name in OUTPUTS:
        error = np.abs(by_numpy[name] - by_compiled[name]).reshape(61, 83, -1).max(axis=-1)
        assert np.count_nonzero(error > 1e-5) <= ROUNDING_SHARE * error.size
