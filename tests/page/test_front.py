"""A page begins where most of the scene is in sight."""

from __future__ import annotations

import numpy as np

from tinysplat_runtime.page.front import front_view
from tinysplat_runtime.scene.cameras import Camera


def camera_at(x: float, focal: float = 60.0) -> Camera:
    K = np.array([[focal, 0, 32], [0, focal, 24], [0, 0, 1.0]])
    c2w = np.eye(4)
    c2w[0, 3] = x
    return Camera(K, c2w, 64, 48)


def test_the_middle_of_a_row_is_in_front() -> None:
    cameras = [camera_at(x) for x in (-0.8, -0.4, 0.0, 0.4, 0.8)]
    assert front_view(cameras) == 2
    assert front_view(cameras[:1]) == front_view([]) == 0


def test_a_wider_lens_is_in_front() -> None:
    assert front_view([camera_at(0.0), camera_at(0.1, focal=30.0), camera_at(0.2)]) == 1
