"""Gaussians that move: their rows, what places them, and what they become."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("numba")

from scenes import make_gaussians

from tinysplat_runtime.render.gradient import MovableGaussians, Target
from tinysplat_runtime.render.kernels_gradient import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED
from tinysplat_runtime.system.threads import Crew

RUN = Crew(1).map


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
    layers = [
        replace(one, means=one.means - np.float32(origin), origin=np.array(origin, float), extra_layers=())
        for one in made.layers
    ]
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


def test_what_is_drawn_follows_the_values_whatever_was_drawn_before() -> None:
    """Few views of a capture are drawn at a time, in memory that the next picture takes over."""
    scene = make_gaussians(9, 6, 7, degree=1)
    photo = np.zeros((6, 7, 3), np.float32)
    field = MovableGaussians(scene, RUN)
    shares = [field.shares(camera) for camera in scene.cameras]

    def seen(drawn: MovableGaussians, view: int) -> float:
        return drawn.measure(Target(scene.cameras[view], photo), shares=shares[view]).absolute

    first = [seen(field, view) for view in (0, 8, 0)]
    assert first[0] == first[2] != first[1]
    field.values[SH_RED:] += 1
    assert seen(field, 8) > first[1]
    assert seen(field, 0) == pytest.approx(seen(MovableGaussians(field.gaussians(scene), RUN), 0), rel=1e-5)
