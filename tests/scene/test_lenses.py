"""Lenses by OpenCV's parameters and COLMAP's models, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.lenses import Lens, opencv_lens

NAMES = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
F, C, SIZE = (70.0, 60.0), (31.0, 25.0), (48, 64)


@pytest.mark.parametrize(
    ("distortion", "fisheye"),
    [
        ({}, False),
        ({"k1": 0.1}, False),
        ({"k2": 0.2}, False),
        ({"p1": 0.3}, False),
        ({"p2": 0.4}, False),
        ({"k1": 0.1, "k2": 0.2, "k3": 0.5, "p1": 0.3, "p2": 0.4}, False),
        ({"k1": 0.1, "k4": 0.2, "k5": 0.3, "k6": 0.4}, False),
        ({"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4}, True),
        ({}, True),
    ],
)
def test_a_lens_bends_rays_as_opencvs_polynomial_does(distortion: dict[str, float], fisheye: bool) -> None:
    pycolmap, values = pytest.importorskip("pycolmap"), [distortion.get(name, 0.0) for name in NAMES]
    k1, k2, k3, k4, k5, k6, p1, p2 = values
    x, y = rays = np.array([[0.2, -0.3, 0.1], [0.1, 0.2, -0.25]])
    r = np.hypot(x, y)
    if fisheye:
        a = np.arctan(r)
        bent = rays * a / r * (1 + k1 * a**2 + k2 * a**4 + k3 * a**6 + k4 * a**8)
    else:
        bent = rays * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
    bent += [2 * p1 * x * y + p2 * (r**2 + 2 * x**2), p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y]
    lens = opencv_lens(F, C, values, SIZE, fisheye=fisheye)
    camera = pycolmap.Camera(model=lens.model, width=lens.width, height=lens.height, params=lens.params)
    found = camera.img_from_cam(np.stack([x, y, np.ones(3)], axis=1))
    np.testing.assert_allclose(found, bent.T * F + C, atol=1e-9)
    assert lens.is_pinhole == (not any(values) and not fisheye)


@pytest.mark.parametrize("name", ["p1", "p2", "k5", "k6"])
def test_terms_that_a_fisheye_has_not_are_refused(name: str) -> None:
    with refusing(InputError, f"{name} 0.1"):
        opencv_lens(F, C, [0.1 * (name == other) for other in NAMES], SIZE, fisheye=True)


@pytest.mark.parametrize(
    "model", ["SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE", "RADIAL_FISHEYE", "FOV"]
)
def test_a_lens_of_a_smaller_copy_has_the_same_rays(model: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    count = len(pycolmap.Camera.create_from_model_name(1, model, 70.0, 64, 48).params)
    focals = 1 if model in ("SIMPLE_RADIAL", "RADIAL", "RADIAL_FISHEYE") else 2
    lens = Lens(model, (*[70.0] * focals, 31.0, 25.0, *[0.02] * (count - focals - 2)), 64, 48)
    rays = np.array([[0.2, 0.1, 1], [-0.3, 0.2, 1]])
    places = []
    for one in (lens, lens.scaled(32, 24)):
        camera = pycolmap.Camera(model=model, width=one.width, height=one.height, params=one.params)
        places.append(camera.img_from_cam(rays))
    np.testing.assert_allclose(places[1], places[0] / 2, atol=1e-9)


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
