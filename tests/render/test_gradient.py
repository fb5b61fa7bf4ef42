"""Gradients of a photo's error are those of what is drawn: finite differences of the float64 reference.

Tolerance: 4e-3 of what all values change together, each up or down by chance, in steps too small for a threshold of
alpha to lie in between; a thousandth of single gradients. Needles hundreds of pixels long, whose edge a rounded axis
turns by a share of its own width, are held to 2 %.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from reference.rasteriser import render_reference, shares
from scenes import make_cameras, make_gaussians, photographed

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.render.gradient import MovableGaussians, Target
from tinysplat_runtime.render.kernels_gradient import BLOCK
from tinysplat_runtime.render.kernels_place import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED, VALUES
from tinysplat_runtime.render.near import Shares
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

RTOL, ATOL = 1e-3, 2e-4
LIFT = np.array([[0, 0, 0, 0], [0, 0, 0, 0.2], [0, 0, 0, -0.1], [0, 0, 0, 0]])  # no centre has a coordinate that is 0


def scene(**changes) -> Gaussians:
    """Two views of 6 x 7 Gaussians of degree 0 and a coarser layer, opacities around a half, some pixels wide."""
    made = make_gaussians(2, 6, 7, degree=0, layers=2, seed=5)
    layers = [dressed(layer, **changes) for layer in made.layers]
    return replace(layers[0], extra_layers=tuple(layers[1:]))


def dressed(layer: Gaussians, size=1.0, stretch=(1, 1, 1), opacity=None) -> Gaussians:
    opacities = 0.2 + 0.6 * layer.opacities if opacity is None else np.full_like(layer.opacities, opacity)
    scales = layer.scales * np.array(stretch) * size
    cameras = tuple(replace(c, c2w=c.c2w + LIFT * (v + 1)) for v, c in enumerate(layer.cameras))
    return replace(layer, scales=scales, opacities=opacities, cameras=cameras, extra_layers=())


def moved(gaussians: Gaussians, values: np.ndarray) -> Gaussians:
    """The definition of `kernels_gradient.VALUES`, in float64: values (6, n) over all layers, in their order."""
    layers, first = [], 0
    for layer in gaussians.layers:
        count = layer.opacities.size
        part = values[:, first : first + count].reshape(VALUES, *layer.opacities.shape)
        away, size = np.exp(part[LOG_DEPTH])[..., None], np.exp(part[LOG_DEPTH] + part[LOG_SIZE])[..., None]
        centres = np.stack([c.centre for c in layer.cameras])[:, None, None] - layer.origin
        sh = layer.sh.astype(np.float64)
        sh[..., 0, :] = np.moveaxis(part[SH_RED:], 0, -1)
        fields = {
            "means": centres + away * (layer.means - centres),
            "quats": layer.quats.astype(np.float64),
            "scales": size * layer.scales,
            "opacities": 1 / (1 + np.exp(-part[LOGIT])),
            "sh": sh,
        }
        layers.append(Gaussians.unchecked(**fields, cameras=layer.cameras, origin=layer.origin))
        first += count
    return Gaussians.stacked(layers)


def compact(field: MovableGaussians, rows: np.ndarray) -> np.ndarray:
    """(6, rows) without the rows between grids."""
    return np.concatenate([rows[:, grid.rows] for grid in field.grids], axis=1)


def found_gradient(
    gaussians: Gaussians,
    camera: Camera,
    photo: np.ndarray,
    threads: int = 2,
    order: str = "depth",
    dilation: str = "own",
    near: Shares | None = None,
    structure: float = 0.0,
):
    field = MovableGaussians(gaussians, Crew(threads).map, dilation)
    gradients = {grid: grid.zeros() for grid in field.grids}
    near = field.shares(camera) if order == "near" else near
    error = field.measure(Target(camera, photo, 1.1, -0.02), shares=near, gradients=gradients, structure=structure)
    found = [gradients[grid][:, : grid.height * grid.width] for grid in field.grids]
    return error, compact(field, field.values).astype(np.float64), np.concatenate(found, axis=1)


@settings(max_examples=15)
@given(photographed(degrees=0))
def test_every_kind_of_value_changes_the_error_as_its_gradient_says(
    made: tuple[Gaussians, Camera, dict[str, str]],
) -> None:
    assert_all_together(*made)


def assert_all_together(gaussians: Gaussians, camera: Camera, drawing: dict[str, str], rtol: float = 4e-3) -> None:
    """All Gaussians at once, each up or down at random; the loss is half |error| and half 1 − SSIM."""
    rng = np.random.default_rng(0)
    photo = rng.uniform(size=(camera.height, camera.width, 3)).astype(np.float32)
    share = shares(gaussians, camera)

    def parts(values: np.ndarray) -> tuple[float, float]:
        found = render_reference(moved(gaussians, values), camera, share=share, **drawing)
        seen = 1.1 * found["rgb"] - 0.02
        return np.abs(seen - photo).sum(), likeness(seen, photo.astype(np.float64))

    def error(values: np.ndarray) -> float:
        absolute, alike = parts(values)
        return 0.5 * absolute + 0.5 * (photo.size - alike)

    measured, values, found = found_gradient(gaussians, camera, photo, structure=0.5, **drawing)
    absolute, alike = parts(values)
    assert measured.absolute == pytest.approx(absolute, rel=1e-4)
    assert measured.alike == pytest.approx(alike, rel=1e-3) and measured.compared == photo.size
    for kind in range(VALUES):
        step = np.zeros_like(values)
        step[kind] = rng.choice([-1e-8, 1e-8], values.shape[1])
        wanted = error(values + step) - error(values - step)
        assert 2 * (found * step).sum() == pytest.approx(wanted, abs=rtol * np.abs(found * step).sum() + 2e-12), kind


def likeness(seen: np.ndarray, photo: np.ndarray) -> float:
    """SSIM (Wang et al. 2004) of every colour of every block of pixels, times its pixels."""
    total, constants = 0.0, (0.01**2, 0.03**2)
    for top, left in itertools.product(*(range(0, side, BLOCK) for side in photo.shape[:2])):
        for x, y in zip(*(one[top:, left:][:BLOCK, :BLOCK].reshape(-1, 3).T for one in (seen, photo)), strict=True):
            (xx, xy), (_, yy) = np.cov(x, y, bias=True)
            products = (2 * x.mean() * y.mean(), x.mean() ** 2 + y.mean() ** 2), (2 * xy, xx + yy)
            total += len(x) * math.prod((a + c) / (b + c) for (a, b), c in zip(products, constants, strict=True))
    return total


def side_camera() -> Camera:
    return Camera([[20, 1.0, 9], [0, 18, 8], [0, 0, 1]], make_cameras(3, 16, 18, spacing=0.5)[0].c2w, 18, 16)


CASES = {
    "ordinary": {},
    "larger": {"size": 4},
    "needles": {"stretch": (40, 0.01, 0.01)},
    "wider than float32 bears": {"stretch": (600, 0.5, 0.5), "opacity": 0.3},
    "opaque": {"opacity": 1.0, "size": 2},
}


@pytest.mark.parametrize(("name", "order"), [*((name, "near") for name in CASES), ("ordinary", "depth")])
def test_gradients_of_extreme_sizes_are_those_of_the_float64_reference(name: str, order: str) -> None:
    tolerance = 2e-2 if name.startswith("wider") else 4e-3
    assert_all_together(scene(**CASES[name]), side_camera(), {"dilation": "own", "order": order}, tolerance)


def crowded(seed: int = 3) -> tuple[Gaussians, Camera]:
    """More than one tile, and more than one batch of records in each."""
    return make_gaussians(3, 40, 48, degree=0, layers=2, seed=seed), make_cameras(3, 70, 300)[0]


def test_gradients_depend_on_neither_threads_nor_repetition() -> None:
    gaussians, camera = crowded()
    photo = np.full((camera.height, camera.width, 3), 0.5, np.float32)
    first, *others = (found_gradient(gaussians, camera, photo, threads)[2] for threads in (1, 2, 5))
    assert all((other == first).all() for other in others)


def test_pixels_that_are_left_open_count_as_unknown_ones() -> None:
    gaussians, camera = scene(opacity=0.3), side_camera()
    field = MovableGaussians(gaussians, Crew(1).map)
    photo = np.random.default_rng(2).uniform(size=(camera.height, camera.width, 3)).astype(np.float32)
    shown = np.empty((*photo.shape[:2], 4), np.float32)
    field.measure(Target(camera, photo), shown=shown)
    most = float(np.median(shown[..., 3]))
    unknown = np.where(shown[..., 3:] > most, np.float32(np.nan), photo)
    again = np.empty_like(shown)
    assert field.measure(Target(camera, photo), shown=again, most_left=most) == field.measure(Target(camera, unknown))
    np.testing.assert_array_equal(shown, again)
    field.measure(Target(camera, photo), shares=field.shares(camera), shown=shown)
    drawn = Renderer(gaussians, 1, compiled=True).render(camera)
    np.testing.assert_allclose(shown[..., :3], drawn, atol=1e-4)
