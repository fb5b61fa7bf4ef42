"""Lenses by OpenCV's parameters and COLMAP's models, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.lenses import Lens, opencv_lens

F, C, SIZE = (70.0, 60.0), (31.0, 25.0), (48, 64)


@pytest.mark.parametrize(
    ("distortion", "fisheye"),
    [
        ((0, 0, 0, 0, 0, 0), False),
        ((0.1, 0, 0, 0, 0, 0), False),
        ((0, 0.2, 0, 0, 0, 0), False),
        ((0, 0, 0, 0, 0.3, 0), False),
        ((0, 0, 0, 0, 0, 0.4), False),
        ((0.1, 0.2, 0.5, 0, 0.3, 0.4), False),
        ((0.1, 0.2, 0.3, 0.4, 0, 0), True),
        ((0, 0, 0, 0, 0, 0), True),
    ],
)
def test_a_lens_bends_rays_as_opencvs_polynomial_does(distortion, fisheye) -> None:
    pycolmap, (k1, k2, k3, k4, p1, p2) = pytest.importorskip("pycolmap"), distortion
    x, y = rays = np.array([[0.2, -0.3, 0.1], [0.1, 0.2, -0.25]])
    r = np.hypot(x, y)
    a = np.arctan(r) if fisheye else r
    bent = rays * a / r * (1 + k1 * a**2 + k2 * a**4 + k3 * a**6 + k4 * a**8)
    bent += [2 * p1 * x * y + p2 * (r**2 + 2 * x**2), p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y]
    lens = opencv_lens(F, C, distortion, SIZE, fisheye=fisheye)
    camera = pycolmap.Camera(model=lens.model, width=lens.width, height=lens.height, params=lens.params)
    found = camera.img_from_cam(np.stack([x, y, np.ones(3)], axis=1))
    np.testing.assert_allclose(found, bent.T * F + C, atol=1e-9)
    assert lens.is_pinhole == (not any(distortion) and not fisheye)


@pytest.mark.parametrize(
    ("distortion", "fisheye", "words"),
    [
        ((0, 0, 0, 0.1, 0, 0), False, "k4 0.1"),
        ((0, 0, 0, 0, 0.1, 0), True, "p1 0.1"),
        ((0, 0, 0, 0, 0, 0.2), True, "p2 0.2"),
    ],
)
def test_terms_that_a_model_has_not_are_refused(distortion, fisheye, words) -> None:
    with refusing(InputError, words):
        opencv_lens(F, C, distortion, SIZE, fisheye=fisheye)


def test_pinholes_have_their_own_intrinsics_and_photos_as_they_are() -> None:
    photo = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    for lens, K in (
        (Lens("PINHOLE", (*F, *C), 64, 48), [[70, 0, 31], [0, 60, 25], [0, 0, 1]]),
        (Lens("SIMPLE_PINHOLE", (70.0, *C), 64, 48), [[70, 0, 31], [0, 70, 25], [0, 0, 1]]),
    ):
        camera = lens.camera(np.eye(4))
        np.testing.assert_array_equal(camera.K, K)
        assert (camera.width, camera.height) == (64, 48) and np.array_equal(lens.undistort(photo), photo)


def test_undistorted_photos_have_the_size_of_their_camera() -> None:
    pytest.importorskip("pycolmap")
    lens = Lens("SIMPLE_RADIAL", (70.0, 32.0, 24.0, 0.3), 64, 48)
    camera = lens.camera(np.eye(4))
    photo = lens.undistort(np.full((48, 64, 3), 90, np.uint8))
    assert photo.shape == (camera.height, camera.width, 3) != (48, 64, 3)
    assert photo.flags.c_contiguous and (photo[2:-2, 2:-2] == 90).all()
    np.testing.assert_allclose(camera.K[:2, 2], [camera.width / 2, camera.height / 2], atol=1.5)
