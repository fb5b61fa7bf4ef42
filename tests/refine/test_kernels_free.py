"""What moves a Gaussian of no pixels, link by link, against finite differences in float64."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from tinysplat_runtime.refine import kernels_free as kf
from tinysplat_runtime.render.kernels_gradient import PAIR, PULL_U, PULL_UU, PULL_UW, PULL_W, PULL_WW
from tinysplat_runtime.render.kernels_project import ALPHA_X, AXES, BETA_X, GAMMA, MEAN
from tinysplat_runtime.render.lists import view_numbers
from tinysplat_runtime.render.project import View
from tinysplat_runtime.scene.cameras import Camera

STEP = 1e-6


@pytest.mark.parametrize(
    "place", [(0.4, -0.3, 3.0), (-2.6, 0.2, 1.5), (0.2, 2.4, 1.6)], ids=["inside", "left", "below"]
)
def test_means_and_footprints_move_with_places_and_scales(place: tuple) -> None:
    """Beside the picture the Jacobian's point stays where it is."""
    rng = np.random.default_rng(0)
    c2w = np.eye(4)
    c2w[:3, :3] = [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]]
    c2w[:3, 3] = 0.1, -0.2, 0.1
    camera = Camera([[30.0, 2, 17], [0, 34, 15], [0, 0, 1]], c2w, 36, 28)
    view, lane = View.of(camera, np.zeros(3), 0.01), 7
    geometry = np.zeros((14, 128), np.float32)
    geometry[MEAN : MEAN + 3, lane], geometry[AXES : AXES + 9, lane] = place, 0.1 * rng.normal(size=9)
    record, total = np.zeros(16, np.float32), rng.normal(size=PAIR)
    record[[ALPHA_X, BETA_X, GAMMA]] = 0.4, -0.15, 0.3
    low, high = -0.15 * np.array([36, 28]) - [17, 15], 1.15 * np.array([36, 28]) - [17, 15]
    F = np.array([[0.4, -0.15], [0, 0.3]])
    Q = np.array([[total[PULL_UU], total[PULL_UW]], [total[PULL_UW], total[PULL_WW]]])
    mean, axes = (geometry[s, lane].astype(np.float64) for s in (slice(MEAN, MEAN + 3), slice(AXES, AXES + 9)))

    def error(moved: np.ndarray) -> float:
        point = view.projection @ (mean + moved[:3] - camera.centre)
        pixel = point[:2] / point[2]
        at = np.clip(pixel, low, high)
        half = (
            (view.projection[:2] - at[:, None] * view.projection[2])
            / point[2]
            @ (axes.reshape(3, 3) * np.exp(moved[3:]))
        )
        return float(2 * F.T @ total[[PULL_U, PULL_W]] @ pixel + 2 * np.trace(F @ half @ half.T @ F.T @ Q))

    found = np.empty(6)
    kf._shape_gradient(record, geometry, lane, view_numbers(view), total, found)
    for kind in range(6):
        step = STEP * np.eye(6)[kind]
        assert found[kind] == pytest.approx((error(step) - error(-step)) / (2 * STEP), rel=2e-4, abs=1e-4), kind


def test_gaussians_are_put_where_their_values_say() -> None:
    rng = np.random.default_rng(1)
    base, values = rng.normal(size=(2, kf.BASE, 128)).astype(np.float32), rng.normal(size=(10, 256)).astype(np.float32)
    values[kf.LOGIT, :3] = -np.inf, 90, -90
    geometry, sh = np.zeros((2, 14, 128), np.float32), np.full((2, 12 * 128), 5, np.float32)
    kf.place(base, values, geometry, sh)
    flat = base.swapaxes(0, 1).reshape(kf.BASE, 256).astype(np.float64)
    placed, wide = geometry.swapaxes(0, 1).reshape(14, 256), values.astype(np.float64)
    np.testing.assert_allclose(placed[:3], flat[:3] + flat[12] * wide[:3], rtol=1e-4, atol=1e-5)
    turned = flat[3:12].reshape(3, 3, 256) * np.exp(wide[3:6])
    np.testing.assert_allclose(placed[3:12].reshape(3, 3, 256), turned, rtol=1e-5)
    np.testing.assert_allclose(placed[12], -np.logaddexp(0, -wide[kf.LOGIT]), rtol=1e-5, atol=1e-30)
    np.testing.assert_array_equal(sh[:, : 3 * 128].reshape(2, 3, 128).swapaxes(0, 1).reshape(3, 256), values[7:])
    assert (sh[:, 3 * 128 :] == 5).all() and not placed[13].any()
