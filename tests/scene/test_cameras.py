"""Cameras check themselves and scale with their images."""

import numpy as np
import pytest
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera, check_is_in_pixels

K = np.array([[100.0, 0, 32], [0, 110, 24], [0, 0, 1]])


def _with(matrix, index, value):
    out = np.array(matrix, float)
    out[index] = value
    return out


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"K": _with(K, (0, 0), -3)}, "K"),
        ({"K": _with(K, (1, 0), 1)}, "K"),
        ({"K": _with(K, (0, 2), np.nan)}, "K"),
        ({"K": "abc"}, "K"),
        ({"c2w": _with(np.eye(4), (0, 0), 1.1)}, "c2w"),
        ({"c2w": np.diag([1.0, 1, -1, 1])}, "c2w"),
        ({"c2w": _with(np.eye(4), (3, 0), 1)}, "c2w"),
        ({"c2w": _with(np.eye(4), (0, 3), np.inf)}, "c2w"),
        ({"height": 1 << 20}, "height"),
        ({"width": 2.5}, "width"),
    ],
)
def test_bad_cameras_are_refused_with_the_field(changes, field):
    with pytest.raises(InputError) as caught:
        Camera(**{"K": K, "c2w": np.eye(4), "width": 64, "height": 48, **changes})
    assert caught.value.where == field
    assert "\n" not in str(caught.value)


def test_intrinsics_that_were_divided_by_the_image_s_size_are_told():
    def check(focal: float, width: int, height: int) -> None:
        check_is_in_pixels(Camera([[focal, 0, 0.5], [0, focal, 0.5], [0, 0, 1]], np.eye(4), width, height), "K")

    for size in ((32, 32), (640, 480)):
        check(16, *size)
        with refusing(InputError, f"K 0.9 {size[0]}x{size[1]}"):
            check(0.9, *size)
    check(1.0, 4, 640)  # a picture this small may have such a focal length
    check(1.0, 640, 4)


def test_a_rotation_written_with_few_digits_is_made_exact():
    c2w = np.eye(4)
    c2w[:3, :3] = np.round([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]], 4) + 2e-5
    R = Camera(K, c2w, 64, 48).rotation
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("size", "scale", "crop"),
    [
        ((48, 64), 1, (0, 0)),
        ((48, 61), 1, (1, 0)),
        ((45, 64), 1, (0, 1)),
        ((96, 64), 2, (32, 0)),
        ((30, 20), 0.625, (10, 0)),
        ((16, 40), 0.625, (0, 7)),
    ],
)
def test_crops_begin_at_whole_pixels(size, scale, crop):
    camera = Camera(_with(K, (0, 1), 3), np.eye(4), np.int64(64), 48)
    found = camera.resized(*size)
    wanted = camera.K * [[scale], [scale], [1]]
    wanted[:2, 2] -= crop
    np.testing.assert_allclose(found.K, wanted, rtol=1e-12)
    assert (found.height, found.width) == size and type(camera.width) is int
