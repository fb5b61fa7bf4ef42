"""One contract for all networks that ship, as users run them: depth where it is known, and finite Gaussians within
their bounds at the edges of what photos, poses and depth ranges can be."""

import numpy as np
import pytest
from networks.two_planes import FAR, NEAR, trace
from numpy.typing import NDArray
from scenes import make_photo
from scipy.spatial.transform import Rotation

import tinysplat_runtime as ts
from tinysplat_runtime.errors import NumericError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.network.predict import predict
from tinysplat_runtime.scene.cameras import Camera

HEIGHT, WIDTH = 32, 48
STORE = GraphStore(threads=1)


def _turn(axis: str, angle: float) -> NDArray:
    return Rotation.from_euler(axis, angle).as_matrix()


def _camera(position: tuple[float, float, float], rotation: NDArray | None = None, focal: float = 40.0) -> Camera:
    c2w = np.eye(4)
    c2w[:3, :3] = np.eye(3) if rotation is None else rotation
    c2w[:3, 3] = position
    return Camera(np.array([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]]), c2w, WIDTH, HEIGHT)


def _photos(views: int = 2) -> NDArray:
    return np.stack([make_photo(HEIGHT, WIDTH, seed=n) for n in range(views)]).astype(np.float32) / 255


def _assert_usable(g: ts.Gaussians, cameras: list[Camera]) -> None:
    for layer in g.layers:
        assert all(np.isfinite(getattr(layer, name)).all() for name in FIELDS)
        assert layer.scales.min() >= 0 and layer.opacities.min() >= 0 and layer.opacities.max() <= 1
    picture = ts.Runtime(threads=1).render(g, cameras[0])
    assert np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1


POSES = {
    "side by side": [_camera((0, 0, 0)), _camera((0.2, 0, 0))],
    "nearly the same place": [_camera((0, 0, 0)), _camera((1e-4, 0, 0))],
    "one behind the other": [_camera((0, 0, 0)), _camera((0, 0, -0.5))],
    "beyond the far plane": [_camera((0, 0, 0)), _camera((0, 0, 100.0))],
    "turned alone": [_camera((0, 0, 0)), _camera((0, 0, 0), _turn("y", 0.2))],
    "turned a millionth": [_camera((0, 0, 0)), _camera((0, 0, 0), _turn("y", 2e-5))],
    "back to back": [_camera((0, 0, 0)), _camera((0.1, 0, 0), _turn("y", np.pi))],
    "face to face": [_camera((0, 0, 0)), _camera((0, 0, 5.0), _turn("y", np.pi))],
    "upside down": [_camera((0, 0, 0)), _camera((0.2, 0, 0), _turn("z", np.pi))],
    "a thousand near planes apart": [_camera((0, 0, 0)), _camera((1000.0, 0, 0))],
    "far from the origin": [_camera((1e7, -1e7, 1e6)), _camera((1e7 + 0.2, -1e7, 1e6))],
    "focal lengths 1000 times apart": [_camera((0, 0, 0), focal=4.0), _camera((0.2, 0, 0), focal=4000.0)],
}

every_network = pytest.mark.parametrize("model", ["sweep", "edge"])


@every_network
@pytest.mark.parametrize("size", [(2, 61, 90), (3, 128, 64), (4, 64, 96)])
def test_depth_of_textured_planes_is_found(model: str, size: tuple[int, int, int]) -> None:
    scene = trace(*size)
    found = predict(scene.images, scene.cameras, NEAR, FAR, STORE.network(model))
    assert found.opacities.shape == scene.depth.shape
    for means, depth, camera in zip(found.means, scene.depth, scene.cameras, strict=True):
        z = ((means.astype(np.float64) - camera.centre) @ camera.rotation.T)[..., 2]
        assert np.median(np.abs(z / depth - 1)) < 0.02
        assert z.min() >= NEAR * (1 - 1e-3) and z.max() <= FAR * (1 + 1e-3)


@every_network
def test_swapped_photos_give_swapped_gaussians(model: str) -> None:
    scene = trace(2, 64, 96)
    graph = STORE.network(model)
    one = predict(scene.images, scene.cameras, NEAR, FAR, graph)
    other = predict(scene.images[::-1], scene.cameras[::-1], NEAR, FAR, graph)
    for name in FIELDS:
        error = np.abs(getattr(one, name) - getattr(other, name)[::-1])
        assert np.quantile(error / np.abs(getattr(one, name)).max(), 0.98) < 1e-3, name


@every_network
@pytest.mark.parametrize("name", POSES)
def test_any_two_different_poses_give_finite_gaussians(model: str, name: str) -> None:
    cameras = POSES[name]
    _assert_usable(predict(_photos(), cameras, 1.0, 8.0, STORE.network(model)), cameras)


@every_network
@pytest.mark.parametrize(("near", "far"), [(1e-4, 1e4), (1.0, 1.0001), (1e-6, 1.0), (1.0, 1e8), (1e5, 1e6)])
def test_any_depth_range_gives_finite_gaussians_or_names_the_cause(model: str, near: float, far: float) -> None:
    cameras = POSES["side by side"]
    try:
        found = predict(_photos(), cameras, near, far, STORE.network(model))
    except NumericError as error:
        assert error.where
    else:
        _assert_usable(found, cameras)


@every_network
@pytest.mark.parametrize("kind", ["black", "white", "one black", "noise", "one pixel", "stripes"])
def test_photos_without_information_give_finite_gaussians(model: str, kind: str) -> None:
    shape = (2, HEIGHT, WIDTH, 3)
    images = {
        "black": np.zeros(shape),
        "white": np.ones(shape),
        "noise": np.random.default_rng(0).random(shape),
        "one pixel": np.zeros(shape),
        "stripes": np.zeros(shape),
        "one black": np.stack([_photos()[0], np.zeros(shape[1:])]),
    }[kind].astype(np.float32)
    if kind == "one pixel":
        images[:, 16, 24] = 1
    if kind == "stripes":
        images[:, :, ::2] = 1
    cameras = POSES["side by side"]
    _assert_usable(predict(images, cameras, 1.0, 8.0, STORE.network(model)), cameras)
