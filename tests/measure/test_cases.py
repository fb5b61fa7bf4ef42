"""Which pixels of a target the context views show: by cameras alone, exact where it can be counted."""

import numpy as np

from tinysplat.measure.subjects.cases import covered_pixels
from tinysplat_runtime.scene.cameras import Camera

FOCAL, WIDTH, HEIGHT = 40.0, 60, 20


def camera(x: float, yaw: float = 0.0) -> Camera:
    c2w = np.eye(4)
    c2w[:3, :3] = [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    c2w[0, 3] = x
    return Camera(np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]), c2w, WIDTH, HEIGHT)


def test_the_uncovered_margin_is_as_wide_as_the_disparity() -> None:
    # all depths alike: 0.5 · 40 / 2 = 10 pixels that lie beyond the context's right border
    assert covered_pixels(camera(0), [camera(0)], 2.0, 9.0).all()
    covered = covered_pixels(camera(0.5), [camera(0)], 2.0, 2.0 + 1e-6)
    assert covered[:, : WIDTH - 10].all() and not covered[:, WIDTH - 10 :].any()


def test_a_view_that_looks_away_or_from_behind_covers_nothing() -> None:
    assert not covered_pixels(camera(0), [camera(0, yaw=np.pi)], 1, 9).any()
    assert not covered_pixels(camera(0), [camera(0, yaw=2.0)], 1, 9).any()
