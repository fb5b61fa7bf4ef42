"""Cameras check themselves and scale with their images."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera

K = np.array([[100.0, 0, 32], [0, 110, 24], [0, 0, 1]])


def _with(matrix, index, value):
    out = np.array(matrix, float)
    out[index] = value
    return out


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"K": _with(K, (0, 0), -3)}, "K"),
        ({"K": _with(K, (1, 1), 0)}, "K"),
        ({"K": _with(K, (2, 2), 2)}, "K"),
        ({"K": _with(K, (1, 0), 1)}, "K"),
        ({"K": _with(K, (0, 2), np.nan)}, "K"),
        ({"K": np.eye(4)}, "K"),
        ({"K": "abc"}, "K"),
        ({"c2w": _with(np.eye(4), (0, 0), 1.1)}, "c2w"),
        ({"c2w": np.diag([1.0, 1, -1, 1])}, "c2w"),
        ({"c2w": _with(np.eye(4), (3, 0), 1)}, "c2w"),
        ({"c2w": _with(np.eye(4), (0, 3), np.inf)}, "c2w"),
        ({"width": 0}, "width"),
        ({"height": 1 << 20}, "height"),
        ({"width": 2.5}, "width"),
    ],
)
def test_bad_cameras_are_refused_with_the_field(changes, field):
    with pytest.raises(InputError) as caught:
        Camera(**{"K": K, "c2w": np.eye(4), "width": 64, "height": 48, **changes})
    assert caught.value.where == field
    assert "\n" not in str(caught.value)


def test_a_rotation_written_with_few_digits_is_made_exact():
    c2w = np.eye(4)
    c2w[:3, :3] = np.round([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]], 4) + 2e-5
    R = Camera(K, c2w, 64, 48).rotation
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


def test_resizing_covers_and_crops_around_the_centre():
    camera = Camera(K, np.eye(4), 64, 48)
    resized = camera.resized(96, 96)
    assert (resized.height, resized.width) == (96, 96)
    # The image's centre stays the image's centre, and the scale is that of the side that just covers.
    np.testing.assert_allclose(resized.K @ [0, 0, 1], [2 * 32 - 16, 48, 1])
    assert resized.K[0, 0] == 200 and resized.K[1, 1] == 220


def test_w2c_undoes_c2w():
    c2w = np.eye(4)
    c2w[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    c2w[:3, 3] = [1, 2, 3]
    np.testing.assert_allclose(Camera(K, c2w, 64, 48).w2c @ c2w, np.eye(4), atol=1e-15)
