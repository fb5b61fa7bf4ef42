"""Fusing: gradients of free Gaussians are finite differences, and pictures by 3DGS' definition come to fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference.rasteriser import render_reference
from scenes import make_cameras, make_list, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats
from tinysplat_runtime.gaussian.thin import thinned
from tinysplat_runtime.refine.descent import Descent, Pace
from tinysplat_runtime.refine.free import FreeGaussians
from tinysplat_runtime.refine.fuse import FuseStats, fused
from tinysplat_runtime.refine.kernels_free import LOG_SCALE, LOGIT, MOVE, SH_RED, TURN
from tinysplat_runtime.render import DEFINITION, render
from tinysplat_runtime.render.gradient import Target
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

STEP = 1e-6
EVERY = Pace(turn=0.01, sh_rest=0.002)


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
        for row in np.argsort(-np.abs(gradient[kind, :30]))[:10]:
            shift = np.zeros_like(values)
            shift[kind, row] = STEP
            wanted = (error(values + shift) - error(values - shift)) / (2 * STEP)
            assert gradient[kind, row] == pytest.approx(wanted, rel=rtol, abs=1e-3 * scale), (kind, row)


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


def test_a_step_moves_every_kind_of_value_down_its_slope_and_no_farther_than_its_size():
    start, photo = before_a_camera(1.0, 1), np.random.default_rng(6).uniform(size=(16, 18, 3)).astype(np.float32)
    descent = Descent(FreeGaussians(start, np.full(30, 0.1, np.float32), Crew(2).map, 4), EVERY, Crew(2).map)
    before = descent.field.values[:, :30].copy()
    descent.step(Target(make_cameras(3, 16, 18, spacing=0.5)[1], photo), 0.0)
    slopes, change = descent.gradient[:, :30], descent.field.values[:, :30] - before
    for kind, size in enumerate(EVERY.step_sizes(0.0, 4)):
        steep = np.abs(slopes[kind]) > 0.1 * np.abs(slopes[kind]).max()
        assert (np.sign(change[kind, steep]) == -np.sign(slopes[kind, steep])).all()
        assert np.abs(change[kind]).max() <= 1.001 * size


def capture() -> Gaussians:
    """Seven views of a painted wall, each of which has it at a depth of its own."""
    cameras = make_cameras(7, 24, 32, turn=0, shift=(0, 0))
    y, x = np.mgrid[:24, :32] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cameras[0].K).T
    away = 3 * (1 + 0.15 * np.random.default_rng(0).standard_normal(7))
    centres = np.stack([camera.centre for camera in cameras])[:, None, None]
    painted = 3 * rays + centres  # where the wall is, whose paint is what photos show
    paint = np.stack([np.sin(3 * painted[..., 0]), np.cos(4 * painted[..., 1]), np.sin(5 * painted.sum(-1))], axis=-1)
    lead = paint.shape[:3]
    quats, scales = np.broadcast_to([1.0, 0, 0, 0], (*lead, 4)), np.full((*lead, 3), 0.05)
    means = away[:, None, None, None] * rays + centres
    return Gaussians(means, quats, scales, np.full(lead, 0.6), paint[..., None, :], tuple(cameras))


def psnr(drawn: Gaussians, wanted: Gaussians) -> float:
    """dB of pictures by 3DGS' definition against those of our own drawing, from a place that was not looked at."""
    camera = wanted.cameras[3]
    c2w = camera.c2w.copy()
    c2w[0, 3] += 0.07
    camera = Camera(camera.K, c2w, camera.width, camera.height)
    return float(-10 * np.log10(np.square(render(drawn, camera, **DEFINITION) - render(wanted, camera)).mean()))


def test_fused_gaussians_show_by_definition_what_our_own_drawing_does():
    whole, stats = capture(), FuseStats()
    found = fused(whole, steps=150, threads=2, stats=stats)
    assert psnr(found, whole) > psnr(thinned(whole), whole)
    assert stats.given == whole.count > stats.thinned >= stats.kept == found.count
    assert stats.steps == 150 and np.mean(stats.rounds[-2]) > np.mean(stats.rounds[0])
    assert tells(stats.text, f"{stats.given} {stats.thinned} {stats.kept} 150") and not found.cameras


def test_the_same_steps_give_the_same_on_any_number_of_threads_and_what_fades_goes():
    whole, stats = capture(), {1: FuseStats(), 3: FuseStats()}
    fast = Pace(move=0, log_scale=0, sh=0, logit=2, last=1, looks=3)  # so that many fade
    one, three = (fused(whole, steps=30, threads=n, pace=fast, stats=stats[n]) for n in (1, 3))
    assert one.count < stats[1].thinned
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))


def test_seconds_or_a_single_step_end_it():
    stats, whole = FuseStats(), capture()
    fused(whole, seconds=0.5, threads=1, stats=stats)
    assert 1 <= stats.steps < 10_000
    fused(whole, steps=1, threads=1, stats=(stats := FuseStats()))
    assert stats.steps == 1


@pytest.mark.parametrize(
    ("wrong", "options", "where"),
    [
        (capture().flat(), {}, "gaussians"),
        (capture(), {"seconds": 0.0}, "seconds"),
        (capture(), {"seconds": float("nan")}, "seconds"),
        (capture(), {"steps": 0}, "steps"),
        (capture(), {"steps": 3, "seconds": 1.0}, "steps"),
    ],
)
def test_what_cannot_be_fused_is_said(wrong: Gaussians, options: dict, where: str) -> None:
    with pytest.raises(InputError) as caught:
        fused(wrong, **options)
    assert caught.value.where == where
