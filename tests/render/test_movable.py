"""Gaussians that move: their rows, what places them, and what they become."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("numba")

from scenes import make_gaussians

from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.render import gradient as module
from tinysplat_runtime.render.gradient import MovableGaussians, Target
from tinysplat_runtime.render.kernels_gradient import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED
from tinysplat_runtime.system.threads import Crew

RUN = Crew(1).map


def test_grids_begin_at_multiples_of_128_rows_and_hold_their_pixels() -> None:
    scene = make_gaussians(2, 10, 15, degree=1, layers=2)  # 150 pixels, and 35 of the second layer
    field = MovableGaussians(scene, RUN)
    found = [(g.layer, g.view, g.rows.start, g.rows.stop, g.height, g.width) for g in field.grids]
    assert found == [(0, 0, 0, 150, 10, 15), (0, 1, 256, 406, 10, 15), (1, 0, 512, 547, 5, 7), (1, 1, 640, 675, 5, 7)]
    assert field.values.shape == (6, 768) and field.values.dtype == np.float32
    for grid in field.grids:
        layer, own = scene.layers[grid.layer], field.values[:, grid.rows]
        opacity = layer.opacities[grid.view].ravel().astype(np.float64).clip(1e-9, 1 - 1e-6)
        np.testing.assert_allclose(own[LOGIT], np.log(opacity / (1 - opacity)), rtol=1e-5)
        np.testing.assert_array_equal(own[SH_RED:], layer.sh[grid.view][..., 0, :].reshape(-1, 3).T)
        assert not own[LOG_DEPTH : LOG_SIZE + 1].any()
    between = np.ones(768, bool)
    for grid in field.grids:
        between[grid.rows] = False
    assert (field.values[LOGIT, between] == -np.inf).all() and not field.values[SH_RED:, between].any()


def test_opacities_at_their_ends_have_logits() -> None:
    scene = make_gaussians(2, 2, 2, degree=0)
    opacities = scene.opacities.copy()
    opacities[0, 0] = 0, 1
    field = MovableGaussians(replace(scene, opacities=opacities), RUN)
    np.testing.assert_allclose(
        1 / (1 + np.exp(-field.values[LOGIT, :2].astype(np.float64))), [1e-9, 1 - 1e-6], rtol=0.02
    )
    found = field.gaussians(replace(scene, opacities=opacities))
    assert found.opacities[0, 0, 0] == 0 and found.opacities[0, 0, 1] == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("origin", [(0, 0, 0), (5.0, -3, 8)])
def test_values_become_gaussians_by_hand(origin: tuple) -> None:
    made = make_gaussians(2, 3, 4, degree=1, layers=2)
    layers = [replace(one, means=one.means - np.float32(origin), origin=np.array(origin, float), extra_layers=())
              for one in made.layers]  # fmt: skip
    scene, rng = replace(layers[0], extra_layers=(layers[1],)), np.random.default_rng(0)
    field = MovableGaussians(scene, RUN)
    field.values[:] += rng.normal(0, 0.3, field.values.shape).astype(np.float32)
    field.values[LOGIT, 5] = np.log(1 / 256 / (1 - 1 / 256))
    found = field.gaussians(scene)
    for grid in field.grids:
        before, after, v = scene.layers[grid.layer], found.layers[grid.layer], grid.view
        own = field.values[:, grid.rows].astype(np.float64).reshape(6, grid.height, grid.width)
        centre = before.cameras[v].centre - scene.origin
        away = np.exp(own[LOG_DEPTH])[..., None]
        np.testing.assert_allclose(after.means[v], centre + away * (before.means[v] - centre), rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(
            after.scales[v], before.scales[v] * away * np.exp(own[LOG_SIZE])[..., None], rtol=1e-5
        )
        opacity = 1 / (1 + np.exp(-own[LOGIT]))
        np.testing.assert_allclose(after.opacities[v], np.where(opacity < 1 / 255, 0, opacity), rtol=1e-5)
        np.testing.assert_allclose(after.sh[v][..., 0, :], np.moveaxis(own[SH_RED:], 0, -1), rtol=1e-6)
        np.testing.assert_array_equal(after.sh[v][..., 1:, :], before.sh[v][..., 1:, :])
        np.testing.assert_array_equal(after.quats[v], before.quats[v])
    assert (found.opacities == 0).sum() >= 1 and found.cameras == scene.cameras and len(found.layers) == 2


def test_views_are_placed_alone_where_they_are_named() -> None:
    scene = make_gaussians(3, 6, 7, degree=0)
    camera, photo = scene.cameras[1], np.zeros((6, 7, 3), np.float32)
    changed, whole = MovableGaussians(scene, RUN), MovableGaussians(scene, RUN)
    first = changed.measure(Target(camera, photo))
    for field in (changed, whole):
        field.values[SH_RED:] += 1
    assert changed.measure(Target(camera, photo)) == first
    changed.place(())
    assert changed.measure(Target(camera, photo)) == first
    whole.place()
    seen = [whole.measure(Target(camera, photo)).absolute]
    for views in ((0,), (1, 2)):
        changed.place(views)
        seen.append(changed.measure(Target(camera, photo)).absolute)
    assert first.absolute < seen[1] < seen[2] == seen[0]


def test_more_than_a_block_of_pixels_is_drawn_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_gaussians(2, 20, 30, degree=1)
    camera = scene.cameras[0].resized(24, 40)
    target = Target(camera, np.random.default_rng(0).uniform(size=(24, 40, 3)).astype(np.float32))
    found = []
    for block in (1 << 14, 256):
        monkeypatch.setattr(module, "BLOCK_SIZE", block)
        field = MovableGaussians(scene, RUN)
        gradient = np.zeros_like(field.values)
        found.append((field.measure(target, gradient=gradient), gradient))
    assert found[0][0].absolute == pytest.approx(found[1][0].absolute, rel=1e-6)
    assert found[0][0].known == 24 * 40
    largest = np.abs(found[0][1]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found[0][1] / largest, found[1][1] / largest, atol=1e-4)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(field.gaussians(scene), name), getattr(scene, name), rtol=1e-5, atol=1e-5)


def test_of_one_view_all_is_drawn_by_depth() -> None:
    scene = make_gaussians(1, 4, 5, degree=0)
    shares = MovableGaussians(scene, RUN).shares(scene.cameras[0])
    assert not shares.has_front and shares.whole.tolist() == [1]
    two = make_gaussians(2, 4, 5, degree=0)
    assert MovableGaussians(two, RUN).shares(two.cameras[0]).has_front
    assert MovableGaussians(two, RUN).shares(two.cameras[0], (0,)).whole.tolist() == [0, 1]
