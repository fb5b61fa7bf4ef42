"""The chain from sums of pixels to what moves a Gaussian, link by link, against finite differences in float64."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from tinysplat_runtime.render import kernels_chain as kc
from tinysplat_runtime.render import kernels_gradient as kg
from tinysplat_runtime.render.kernels_project import ALPHA_X, AXES, BETA_X, GAMMA, MEAN, OWN_PIXEL
from tinysplat_runtime.render.lists import view_numbers
from tinysplat_runtime.render.project import View
from tinysplat_runtime.scene.cameras import Camera

STEP = 1e-6


def share_of_opacity(own: float, covariance: np.ndarray) -> float:
    """½ ln (det(Σ + 0.3 m²·1) / det(Σ + 0.3·1)), m at least an eighth; see `project.py`."""
    own = max(own, 1 / 8)
    wide, usual = (np.linalg.det(covariance + 0.3 * m * m * np.eye(2)) for m in (own, 1.0))
    return float(0.5 * np.log(wide / usual))


def dilation(own: float, covariance: np.ndarray) -> float:
    return max(0.3, 0.3 * own * own - float(np.linalg.eigvalsh(covariance)[0]))


CASES = [(0.02, [2.0, 0.7, 1.0]), (0.3, [1.0, -0.4, 3.0]), (0.9, [0.2, 0.05, 0.1]), (1.5, [0.1, 0.02, 0.3]),
         (3.0, [1.0, 0.8, 2.0]), (4.0, [0.5, 0.0, 0.5]), (1.2, [4.0, 1.0, 5.0])]  # fmt: skip


@pytest.mark.parametrize(("own", "entries"), CASES)
def test_fading_and_widening_follow_depth_and_size(own: float, entries: list[float]) -> None:
    """With depth the covariance changes by `change` and own pixels by `wider`; with size it grows twofold."""
    change, wider = (0.3, -0.2, 0.5), -0.7
    a, b, c = entries
    sigma, dsigma = np.array([[a, b], [b, c]]), np.array([[change[0], change[1]], [change[1], change[2]]])
    link, of = (kc._widening, dilation) if own > 1 else (kc._fading, share_of_opacity)
    by_depth, by_size = link(own, wider, (a, b, c), change)
    ends = [of(own * np.exp(sign * STEP * wider), sigma + sign * STEP * dsigma) for sign in (1, -1)]
    assert by_depth == pytest.approx((ends[0] - ends[1]) / (2 * STEP), rel=1e-5, abs=1e-7)
    ends = [of(own, sigma * np.exp(2 * sign * STEP)) for sign in (1, -1)]
    assert by_size == pytest.approx((ends[0] - ends[1]) / (2 * STEP), rel=1e-5, abs=1e-7)


@pytest.mark.parametrize(
    "place", [(0.4, -0.3, 3.0), (-2.6, 0.2, 1.5), (0.2, 2.4, 1.6)], ids=["inside", "left", "below"]
)
@pytest.mark.parametrize("own_pixel", [0.0, 0.004, 0.5])
def test_means_and_footprints_move_with_depth_and_size(place: tuple, own_pixel: float) -> None:
    """Along the own camera's ray mean, axes and own pixel grow alike; beside the picture the Jacobian's point stays."""
    rng = np.random.default_rng(0)
    c2w = np.eye(4)
    c2w[:3, :3] = [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]]
    c2w[:3, 3] = 0.1, -0.2, 0.1
    camera, centre = Camera([[30.0, 2, 17], [0, 34, 15], [0, 0, 1]], c2w, 36, 28), np.array([0.5, 0.3, -0.4])
    view = View.of(camera, np.zeros(3), 0.01)
    geometry, lane = np.zeros((14, 128), np.float32), 5
    geometry[MEAN : MEAN + 3, lane] = place
    geometry[AXES : AXES + 9, lane] = 0.1 * rng.normal(size=9)
    geometry[OWN_PIXEL, lane] = own_pixel
    record, total = np.zeros(16, np.float32), rng.normal(size=kg.PAIR)
    record[[ALPHA_X, BETA_X, GAMMA]] = 0.4, -0.15, 0.3
    low, high = -0.15 * np.array([36, 28]) - [17, 15], 1.15 * np.array([36, 28]) - [17, 15]

    def shape(log_depth: float, log_size: float) -> tuple[np.ndarray, np.ndarray, float]:
        away = np.exp(log_depth)
        mean = centre + away * (geometry[MEAN : MEAN + 3, lane].astype(np.float64) - centre)
        axes = away * np.exp(log_size) * geometry[AXES : AXES + 9, lane].astype(np.float64).reshape(3, 3)
        point = view.projection @ (mean - camera.centre)
        pixel = point[:2] / point[2]
        at = np.clip(pixel, low, high)
        half = (view.projection[:2] - at[:, None] * view.projection[2]) / point[2] @ axes
        return pixel, half @ half.T, away * own_pixel * camera.focal / point[2]

    F = np.array([[0.4, -0.15], [0, 0.3]])
    Q = np.array([[total[kg.PULL_UU], total[kg.PULL_UW]], [total[kg.PULL_UW], total[kg.PULL_WW]]])
    pixel_0, _, own_0 = shape(0, 0)
    assert (np.clip(pixel_0, low, high) == pixel_0).all() == (place[0] == 0.4)

    def error(log_depth: float, log_size: float) -> float:
        pixel, sigma, own = shape(log_depth, log_size)
        if own_0 > 1:
            sigma = sigma + dilation(own, sigma) * np.eye(2)
        faded = share_of_opacity(own, sigma) if 0 < own_0 <= 1 else 0.0
        moved = 2 * F.T @ total[[kg.PULL_U, kg.PULL_W]] @ pixel
        return float(moved + 2 * np.trace(F @ sigma @ F.T @ Q) + faded * total[kg.PULL])

    found = kc._shape_gradient(record, geometry, lane, centre, view_numbers(view), total)
    for got, (depth, size) in zip(found, ((STEP, 0), (0, STEP)), strict=True):
        wanted = (error(depth, size) - error(-depth, -size)) / (2 * STEP)
        assert got == pytest.approx(wanted, rel=2e-4, abs=1e-4)
