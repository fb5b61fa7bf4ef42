"""Steps of free Gaussians by hand: how far, of what kind, and what goes on with those that are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_cameras, make_free_gaussians

from tinysplat_runtime.refine.descent import LIMITS, Descent, Pace, units
from tinysplat_runtime.refine.free import FreeGaussians
from tinysplat_runtime.render.gradient import PhotoError, Target
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

RUN = Crew(1).map
KINDS = [0, 0, 0, 1, 1, 1, 2, 3, 3, 3]  # moves, logarithms of scales, logit, colours


def test_steps_fall_to_what_is_left_evenly_on_a_logarithmic_scale() -> None:
    pace = Pace(move=1, log_scale=2, logit=3, sh=4, last=0.01)
    for way, share in ((0, 1), (0.5, 0.1), (1, 0.01), (7, 0.01)):
        np.testing.assert_allclose(pace.step_sizes(way), np.array([1, 1, 1, 2, 2, 2, 3, 4, 4, 4]) * share)
    usual = Pace()
    assert 0 < usual.last < 1 and 0 < usual.momentum < usual.memory < 1 and usual.looks > 1
    assert max(usual.step_sizes(0)) == usual.move < 0.5 and usual.noise < 0.01 < usual.logit
    assert usual.sh < usual.log_scale < usual.logit


def test_limits_leave_a_way_back() -> None:
    assert (
        len(LIMITS) == 10 and len({LIMITS[kind] for kind in range(3)}) == len({LIMITS[kind] for kind in (3, 4, 5)}) == 1
    )
    assert all(low < 0 < high for low, high in LIMITS)
    opacity = 1 / (1 + np.exp(-np.array(LIMITS[6])))
    assert opacity[0] < 1e-5 and 0.99 < opacity[1] < 0.9995
    assert LIMITS[7:] == ((-4, 8),) * 3 and LIMITS[0] == (-200, 200) and LIMITS[3] == (-30, 30)


def descent(count: int = 5, pace: Pace | None = None, **options) -> Descent:
    made = make_free_gaussians(count, 1, np.random.default_rng(0))
    return Descent(FreeGaussians(made, np.ones(count), RUN), pace or Pace(), RUN, **options)


def test_first_steps_are_those_of_adam(monkeypatch: pytest.MonkeyPatch) -> None:
    pace = Pace(move=1, log_scale=2, logit=3, sh=4, last=0.25, momentum=0.5, memory=0.75, noise=0.5)
    found, placed = descent(pace=pace, limits=[(-99.0, 99.0)] * 10), []
    before = found.field.values[:, :5].copy()
    slopes = [np.arange(10)[:, None] - 4.5 + np.zeros(5), np.full((10, 5), 2.0)]

    def measure(self: FreeGaussians, target: Target, *, gradient: np.ndarray) -> PhotoError:
        assert not gradient.any()
        gradient[:, :5] += slopes[found.count]
        return PhotoError(found.count, 2, 3, 4, 5)

    monkeypatch.setattr(FreeGaussians, "measure", measure)
    monkeypatch.setattr(FreeGaussians, "place", lambda self: placed.append(self))
    target = Target(make_cameras(1)[0], np.zeros((8, 12, 3), np.float32))
    sizes = np.array([(1.0, 2.0, 3.0, 4.0)[kind] for kind in KINDS])[:, None]
    assert found.step(target, 0.5).absolute == 0 and placed == [found.field] and found.count == 1
    first = before - 0.5 * sizes * slopes[0] / (np.abs(slopes[0]) + 0.5)
    np.testing.assert_allclose(found.field.values[:, :5], first, rtol=1e-5, atol=1e-5)
    assert found.correct(target, 1.0).absolute == 1 and len(placed) == 1 and found.count == 2
    m = (0.25 * slopes[0] + 0.5 * slopes[1]) / 0.75
    v = (0.75 * 0.25 * slopes[0] ** 2 + 0.25 * slopes[1] ** 2) / (1 - 0.75**2)
    second = first - 0.25 * sizes * m / (np.sqrt(v) + 0.5)
    np.testing.assert_allclose(found.field.values[:, :5], second, rtol=1e-5, atol=1e-5)


def test_those_that_are_kept_go_on_with_their_own_means() -> None:
    found = descent(200)
    found.means[:] = np.arange(found.means.size, dtype=np.float32).reshape(found.means.shape)
    before, values = found.means.copy(), found.field.values.copy()
    keep = np.arange(200) % 3 == 1
    found.keep(keep)
    assert found.field.count == keep.sum() == 67 and found.means.shape == (2, 10, 128)
    np.testing.assert_array_equal(found.means[..., :67], before[..., :200][..., keep])
    assert not found.means[..., 67:].any() and found.gradient.shape == (10, 128)
    np.testing.assert_allclose(found.field.values[3:, :67], values[3:, :200][:, keep], rtol=1e-4, atol=1e-5)


def test_a_unit_is_the_pixel_of_the_view_that_shows_largest() -> None:
    made = make_free_gaussians(3, 0, np.random.default_rng(0))
    made = replace(made, means=np.array([[0, 0, 5.0], [0, 0, -4], [0, 0, 20]]), origin=np.array([1.0, 0, 0]))
    near = Camera([[10.0, 0, 2], [0, 10, 2], [0, 0, 1]], np.eye(4), 4, 4)
    back = Camera([[20.0, 0, 2], [0, 20, 2], [0, 0, 1]], np.diag([-1.0, 1, -1, 1]), 4, 4)
    c2w = np.eye(4)
    c2w[2, 3] = -20
    far = Camera([[50.0, 0, 2], [0, 50, 2], [0, 0, 1]], c2w, 4, 4)
    np.testing.assert_allclose(units(made, [near]), [0.5, 1, 2], rtol=1e-6)
    np.testing.assert_allclose(units(made, [near, back]), [0.5, 0.2, 2], rtol=1e-6)
    np.testing.assert_allclose(units(made, [near, back, far]), [0.5, 0.2, 0.8], rtol=1e-6)


def test_axes_too_thin_for_logarithms_begin_at_a_ten_thousandth_of_the_unit() -> None:
    made = make_free_gaussians(2, 0, np.random.default_rng(0))
    made = replace(made, scales=np.array([[0, 1e-3, 0.5], [3e-5, 1e-9, 2]]), opacities=np.array([0.0, 1.0]))
    found = FreeGaussians(made, np.array([2.0, 0.1]), RUN)
    np.testing.assert_allclose(found.gaussians().scales, [[2e-4, 1e-3, 0.5], [3e-5, 1e-5, 2]], rtol=1e-5)
    np.testing.assert_allclose(found.opacities, [1e-9, 1 - 1e-6], rtol=1e-4)
    assert found.count == 2 and found.values.shape == (10, 128) and (found.values[6, 2:] == -np.inf).all()


def test_more_than_a_block_is_cut_into_pieces_that_draw_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    from tinysplat_runtime.refine import free

    made = make_free_gaussians(700, 1, np.random.default_rng(1))
    camera = make_cameras(1, 24, 40, shift=(0, 0))[0]
    camera = Camera(camera.K, camera.c2w - 3 * np.eye(4)[2][:, None] * np.eye(4)[3], 40, 24)
    target = Target(camera, np.random.default_rng(2).uniform(size=(24, 40, 3)).astype(np.float32))
    errors, gradients = [], []
    for block in (1 << 14, 256):
        monkeypatch.setattr(free, "BLOCK_SIZE", block)
        field = FreeGaussians(made, np.full(700, 0.5), RUN)
        gradient = np.zeros_like(field.values)
        errors.append(field.measure(target, gradient=gradient, weight=2.0))
        gradients.append(gradient)
        once = np.zeros_like(gradient)
        field.measure(target, gradient=once)
        np.testing.assert_allclose(gradient, 2 * once, rtol=1e-4, atol=1e-4 * np.abs(once).max())
    assert [piece.rows for piece in field.pieces] == [slice(0, 256), slice(256, 512), slice(512, 768)]
    assert errors[0].absolute == pytest.approx(errors[1].absolute, rel=1e-6) and errors[0].known == 24 * 40
    np.testing.assert_allclose(gradients[0], gradients[1], rtol=1e-3, atol=1e-4 * np.abs(gradients[0]).max())
    np.testing.assert_allclose(field.gaussians().sh, made.sh, rtol=1e-6)
