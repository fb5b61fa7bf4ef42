"""Lenses by OpenCV's parameters and COLMAP's models, and what is none."""

import numpy as np
import pytest

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
