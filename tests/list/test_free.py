"""Gaussians of no pixels: their gradients are finite differences, and steps go down them."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from reference.rasteriser import render_reference
from scenes import make_cameras, make_list

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats
from tinysplat_runtime.list.training.descent import Descent, Pace
from tinysplat_runtime.list.training.free import FreeGaussians
from tinysplat_runtime.list.training.kernels_free import LOG_SCALE, LOGIT, MOVE, SH_RED, TURN
from tinysplat_runtime.render.gradient import Target
from tinysplat_runtime.render.kernels_gradient import BLOCK
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

STEP = 1e-6


def moved(start: Gaussians, units: np.ndarray, values: np.ndarray) -> Gaussians:
    """The definition of the values, in float64."""
    sh = start.sh.astype(np.float64)
    functions = (len(values) - SH_RED) // 3
    sh[:, :functions] = values[SH_RED:].T.reshape(-1, functions, 3)
    return Gaussians.unchecked(
        means=start.means + units[:, None] * values[MOVE:LOG_SCALE].T,
        quats=(values[TURN:LOGIT] / np.linalg.norm(values[TURN:LOGIT], axis=0)).T,
        scales=np.exp(values[LOG_SCALE:TURN]).T,
        opacities=1 / (1 + np.exp(-values[LOGIT])),
        sh=sh,
    )


def before_a_camera(size: float, degree: int = 0) -> Gaussians:
    """Thirty, about 3 before the origin, opacities around a half."""
    made = make_list(30, degree, np.random.default_rng(3))
    means = np.random.default_rng(4).uniform([-1.2, -1, 2], [1.2, 1, 4], (30, 3))
    return replace(made, means=means, opacities=0.2 + 0.6 * made.opacities, scales=size * (0.02 + made.scales))


@pytest.mark.parametrize(("size", "degree", "rtol"), [(0.3, 0, 1e-3), (1.5, 0, 1e-3), (80.0, 0, 2e-2), (1.5, 2, 1e-3)])
def test_gradients_are_finite_differences_of_the_float64_reference(size: float, degree: int, rtol: float) -> None:
    """But for what colours of degree 1 and up change by as a Gaussian moves."""
    start, units = before_a_camera(size, degree), np.random.default_rng(5).uniform(0.01, 0.2, 30).astype(np.float32)
    camera = Camera([[20, 1.0, 9], [0, 18, 8], [0, 0, 1]], make_cameras(3, 16, 18, spacing=0.5)[0].c2w, 18, 16)
    photo = np.random.default_rng(6).uniform(size=(16, 18, 3)).astype(np.float32)
    free = FreeGaussians(start, units, Crew(2).map, (degree + 1) ** 2)
    free.values[TURN:LOGIT, :30] *= np.random.default_rng(7).uniform(0.5, 2, 30)  # lengths say nothing
    gradient = np.zeros_like(free.values)
    free.measure(Target(camera, photo), gradient=gradient)
    values = free.values[:, :30].astype(np.float64)

    def error(values: np.ndarray) -> float:
        return float(np.abs(render_reference(moved(start, units, values), camera)["rgb"] - photo).sum())

    for kind in range(MOVE if degree == 0 else LOG_SCALE, len(values)):
        scale = float(np.abs(gradient[kind]).max())
        assert scale > 0
        for row in np.argsort(-np.abs(gradient[kind, :30]))[: 10 - 4 * degree]:
            shift = np.zeros_like(values)
            shift[kind, row] = STEP
            wanted = (error(values + shift) - error(values - shift)) / (2 * STEP)
            assert gradient[kind, row] == pytest.approx(wanted, rel=rtol, abs=1e-3 * scale), (kind, row)


@pytest.mark.parametrize("backdrop", [0.0, 0.4])
def test_structure_changes_as_gradients_say_where_photos_know_something(backdrop: float) -> None:
    """All Gaussians at once, each up or down at random; the loss is half |error| and half 1 − SSIM."""
    start, units = before_a_camera(1.5), np.full(30, 0.1, np.float32)
    camera = Camera([[40, 1.0, 20], [0, 38, 14], [0, 0, 1]], make_cameras(3, 29, 42, spacing=0.5)[0].c2w, 42, 29)
    photo = np.random.default_rng(6).uniform(size=(29, 42, 3)).astype(np.float32)
    photo[5:12, 20:30] = np.nan
    free = FreeGaussians(start, units, Crew(2).map)
    gradient = np.zeros_like(free.values)
    error = free.measure(Target(camera, photo).before(backdrop), gradient=gradient, structure=0.5)
    values = free.values[:, :30].astype(np.float64)

    def seen(values: np.ndarray) -> np.ndarray:
        found = render_reference(moved(start, units, values), camera)
        return found["rgb"] + backdrop * (1 - found["alpha"][..., None])

    def loss(values: np.ndarray) -> float:
        return float(0.5 * np.nansum(np.abs(seen(values) - photo)) - 0.5 * likeness(seen(values), photo))

    known = np.isfinite(photo[..., 0])
    assert error.psnr == pytest.approx(
        -10 * np.log10(np.square(seen(values).clip(0, 1) - photo)[known].mean()), abs=1e-3
    )
    rng = np.random.default_rng(0)
    for kind in range(len(values)):
        step = np.zeros_like(values)
        step[kind] = rng.choice([-1e-7, 1e-7], 30)
        wanted = loss(values + step) - loss(values - step)
        whole = np.abs(gradient[kind, :30] * step[kind]).sum()
        assert 2 * (gradient[:, :30] * step).sum() == pytest.approx(wanted, abs=4e-3 * whole + 2e-11), kind


def likeness(seen: np.ndarray, photo: np.ndarray) -> float:
    """SSIM (Wang et al. 2004) of every colour of every block of pixels that is known, times its pixels."""
    total, constants = 0.0, (0.01**2, 0.03**2)
    for top, left in itertools.product(*(range(0, side, BLOCK) for side in photo.shape[:2])):
        for x, y in zip(*(one[top:, left:][:BLOCK, :BLOCK].reshape(-1, 3).T for one in (seen, photo)), strict=True):
            if np.isnan(y).any():
                continue
            (xx, xy), (_, yy) = np.cov(x, y, bias=True)
            products = (2 * x.mean() * y.mean(), x.mean() ** 2 + y.mean() ** 2), (2 * xy, xx + yy)
            total += len(x) * math.prod((a + c) / (b + c) for (a, b), c in zip(products, constants, strict=True))
    return total


def test_gradients_depend_on_neither_threads_nor_repetition() -> None:
    start, camera = make_list(3000, 1, np.random.default_rng(0)), make_cameras(3, 70, 300)[0]
    start = replace(start, means=np.random.default_rng(4).uniform([-4, -1, 2], [4, 1, 4], (3000, 3)))
    found = []
    for threads in (1, 2, 5, 5):
        free = FreeGaussians(start, np.ones(3000, np.float32), Crew(threads).map, 4)
        found.append(np.zeros_like(free.values))
        free.measure(Target(camera, np.full((70, 300, 3), 0.5, np.float32)), gradient=found[-1], structure=0.2)
    assert np.abs(found[0]).max() > 0 and all((other == found[0]).all() for other in found[1:])


def test_free_gaussians_are_what_they_were_until_they_move_and_lose_only_what_is_dropped():
    start = before_a_camera(1.0)
    start = replace(start, quats=normalize_quats(start.quats))
    free = FreeGaussians(start, np.ones(30), Crew(1).map)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(free.gaussians(), name), getattr(start, name), rtol=1e-5, atol=1e-6)
    free.values[MOVE, :30] += 0.5
    kept = free.kept(np.arange(30) % 3 == 0)
    assert kept.count == 10
    np.testing.assert_allclose(kept.gaussians().means, start.means[::3] + np.array([0.5, 0, 0]), atol=1e-6)


def test_a_step_without_some_gaussians_corrects_the_others_as_if_these_were_as_opaque_on_the_mean():
    start = replace(before_a_camera(1.0), opacities=np.full(30, 0.25))
    photo = np.random.default_rng(6).uniform(size=(16, 18, 3)).astype(np.float32)
    target = Target(make_cameras(1, 16, 18)[0], photo)
    pace, absent = Pace(move=0.1, logit=0.0), np.arange(30) % 2 == 0
    found = Descent(FreeGaussians(start, np.ones(30, np.float32), Crew(2).map), pace, Crew(2).map)
    twice = start.taken(~absent).changed(opacities=np.full(15, 0.5, np.float32))
    others = Descent(FreeGaussians(twice, np.ones(15, np.float32), Crew(2).map), pace, Crew(2).map)
    error, wanted = found.step(target, 0.0, absent=absent), others.step(target, 0.0)
    assert error.psnr == pytest.approx(wanted.psnr, abs=1e-3)
    left = found.field.gaussians()
    np.testing.assert_array_equal(left.means[absent], start.means.astype(np.float32)[absent])
    np.testing.assert_allclose(left.means[~absent], others.field.gaussians().means, atol=1e-4)
    np.testing.assert_allclose(left.opacities, 0.25, rtol=1e-5)
