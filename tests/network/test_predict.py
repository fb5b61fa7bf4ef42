"""The host side of a network: what it refuses, padding and cropping, the origin, and what it makes of the outputs."""

from collections.abc import Mapping

import numpy as np
import pytest
from networks.two_planes import FAR, NEAR, row_of_cameras
from scenes import refusing

from tinysplat_runtime.errors import InputError, ModelError, NumericError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.graphs.inference import Graph
from tinysplat_runtime.network.predict import FAR_FROM_ORIGIN, predict
from tinysplat_runtime.scene.cameras import Camera

CELL = 4


class PlaneSession:
    """Stands in for onnxruntime: a fronto-parallel plane at z = 3, and what it was asked."""

    def __init__(self, **replaced: np.ndarray | float) -> None:
        self.replaced = replaced
        self.inputs: dict[str, np.ndarray] = {}

    def run(self, names: list[str], inputs: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        self.inputs = dict(inputs)
        views, _, height, width = inputs["images"].shape
        outputs = {
            **self._layer("", views, height, width),
            **self._layer("layer1_", views, height // CELL, width // CELL),
            "layer1_K": inputs["K"] * np.float32([[[width / CELL], [height / CELL], [1]]]),
        }
        for name, value in self.replaced.items():
            outputs[name] = value if isinstance(value, np.ndarray) else np.full_like(outputs[name], value)
        return [outputs[name] for name in names]

    def _layer(self, prefix: str, views: int, height: int, width: int) -> dict[str, np.ndarray]:
        c2w = self.inputs["c2w"]
        means = c2w[:, None, None, :3, 3] + 3 * c2w[:, None, None, :3, 2] + np.zeros((views, height, width, 1))
        arrays = {
            "means": means,
            "quats": np.broadcast_to([1.0, 0, 0, 0], (views, height, width, 4)),
            "scales": np.full((views, height, width, 3), 0.01),
            "opacities": np.full((views, height, width), 0.5),
            "sh": np.zeros((views, height, width, 1, 3)),
        }
        return {prefix + name: np.float32(array) for name, array in arrays.items()}


def plane_graph(stride: int = 4, **replaced: np.ndarray | float) -> tuple[Graph, PlaneSession]:
    session = PlaneSession(**replaced)
    fields = ("means", "quats", "scales", "opacities", "sh")
    names = (*fields, *(f"layer1_{f}" for f in fields), "layer1_K")
    metadata = {"min_views": 2, "max_views": 6, "stride": stride, "min_side": 16}
    return Graph("plane", session, metadata, names), session


def grey(views: int = 2, height: int = 16, width: int = 24) -> np.ndarray:
    return np.full((views, height, width, 3), 0.5, np.float32)


def moved(cameras: tuple[Camera, ...], by: np.ndarray) -> tuple[Camera, ...]:
    shift = np.eye(4)
    shift[:3, 3] = by
    return tuple(Camera(c.K, shift @ c.c2w, c.width, c.height) for c in cameras)


def run_plane(images: np.ndarray, cameras, near=NEAR, far=FAR, **replaced) -> Gaussians:
    return predict(images, cameras, near, far, plane_graph(**replaced)[0])


def test_layers_come_back_with_the_photos_cameras_and_their_own_intrinsics():
    cameras = row_of_cameras(2, 16, 24)
    gaussians = run_plane(grey(), cameras)
    assert gaussians.opacities.shape == (2, 16, 24)
    assert [c.c2w.tolist() for c in gaussians.cameras] == [c.c2w.tolist() for c in cameras]
    (coarse,) = gaussians.extra_layers
    assert coarse.opacities.shape == (2, 4, 6)
    for camera, photo in zip(coarse.cameras, cameras, strict=True):
        np.testing.assert_allclose(camera.K[:2], photo.K[:2] / CELL, rtol=1e-6)
        np.testing.assert_array_equal(camera.c2w, photo.c2w)


@pytest.mark.parametrize(("height", "width"), [(17, 24), (16, 27), (9, 5), (19, 21)])
def test_sizes_off_the_stride_are_padded_by_the_edge_and_cropped_back(height, width):
    images = np.random.default_rng(0).random((2, height, width, 3), np.float32)
    cameras = row_of_cameras(2, height, width)
    graph, session = plane_graph()
    gaussians = predict(images, cameras, NEAR, FAR, graph)
    assert gaussians.opacities.shape == (2, height, width)
    fed = session.inputs["images"]
    assert fed.shape[2] % 4 == 0 and fed.shape[3] % 4 == 0 and min(fed.shape[2:]) >= 16
    np.testing.assert_array_equal(fed[:, :, :height, :width], images.transpose(0, 3, 1, 2))
    np.testing.assert_array_equal(fed[:, :, -1, :width], fed[:, :, height - 1, :width])
    size = np.array([[fed.shape[3]], [fed.shape[2]], [1]])
    np.testing.assert_allclose(session.inputs["K"] * size, [c.K for c in cameras], rtol=1e-6)


def test_graph_sees_the_mean_camera_centre_as_its_origin():
    cameras = moved(row_of_cameras(3, 16, 24), np.array([5e5, 4e6, 100.0]))
    graph, session = plane_graph()
    predict(grey(3), cameras, NEAR, FAR, graph)
    np.testing.assert_allclose(session.inputs["c2w"][:, :3, 3].mean(axis=0), 0, atol=1e-6)
    np.testing.assert_allclose(session.inputs["c2w"][:, 0, 3], [-0.2, 0, 0.2], atol=1e-6)


def test_origin_stays_zero_near_the_world_origin_and_is_kept_far_from_it():
    cameras = row_of_cameras(2, 16, 24)
    near_by = moved(cameras, np.array([0.9 * FAR_FROM_ORIGIN * NEAR, 0, 0]))
    far_off = moved(cameras, np.array([5e5, 4e6, 100.0]))
    close, distant = run_plane(grey(), near_by), run_plane(grey(), far_off)
    assert (close.origin == 0).all()
    np.testing.assert_array_equal(distant.origin, np.mean([c.centre for c in far_off], axis=0))
    for gaussians, views in ((close, near_by), (distant, far_off)):
        for layer in gaussians.layers:
            assert (layer.origin == gaussians.origin).all()
            for v, camera in enumerate(views):
                local = (layer.means[v].astype(np.float64) + layer.origin - camera.centre) @ camera.rotation.T
                np.testing.assert_allclose(local[..., 2], 3, atol=1e-4)


ROW = row_of_cameras(7, 16, 24)


def with_value(value: float) -> np.ndarray:
    images = grey()
    images[1, 3, 4, 0] = value
    return images


@pytest.mark.parametrize(
    ("images", "cameras", "depths", "said"),
    [
        (grey(), ROW[:2], (0, 5), "near: "),
        (grey(), ROW[:2], (1, np.nan), "far: "),
        (grey(), ROW[:2], (5, 5), "near: "),
        (grey(), ROW[:2], (1e-300, 1.0), "near 1e-30"),
        (grey(), ROW[:2], (1.0, 1e300), "far 1e-30"),
        (grey(1), ROW[:1], (NEAR, FAR), "images: "),
        (grey(7), ROW, (NEAR, FAR), "2 to 6"),
        (grey(3), (*ROW[:2], ROW[0]), (NEAR, FAR), "cameras: views 0 and 2"),
        (grey(3), (*ROW[:2], *moved(ROW[1:2], np.full(3, 1e-7))), (NEAR, FAR), "cameras: views 1 and 2"),
        (with_value(np.nan), ROW[:2], (NEAR, FAR), "images[1]: "),
        (with_value(255), ROW[:2], (NEAR, FAR), "images[1]: "),
        (grey(), (ROW[0], Camera(ROW[1].K, ROW[1].c2w, 24, 20)), (NEAR, FAR), "cameras[1]: 24x20, expected 24x16"),
        (np.zeros((2, 16, 24), np.float32), ROW[:2], (NEAR, FAR), "images: "),
    ],
)
def test_what_a_network_cannot_be_given_is_refused(images, cameras, depths, said):
    with refusing(InputError, said):
        run_plane(images, cameras, *depths)


def test_a_pure_rotation_is_not_an_identical_pose():
    first = row_of_cameras(2, 16, 24)[0]
    turned = np.array(first.c2w)
    turned[:3, :3] = turned[:3, :3] @ [[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]
    assert run_plane(grey(), (first, Camera(first.K, turned, 24, 16))).opacities.shape == (2, 16, 24)


@pytest.mark.parametrize("name", ["means", "layer1_scales", "layer1_K"])
def test_outputs_that_are_not_finite_are_named(name):
    with pytest.raises(NumericError) as caught:
        run_plane(grey(), row_of_cameras(2, 16, 24), **{name: np.nan})
    assert caught.value.where is not None and caught.value.where.startswith(name)


@pytest.mark.parametrize(
    ("metadata", "words"),
    [({"stride": "four"}, "'stride'"), ({"stride": 10**6}, "'stride' 1000000"), ({"max_views": 1}, "2 to 1")],
)
def test_metadata_that_no_network_can_mean_is_refused(metadata, words):
    graph = Graph("odd", PlaneSession(), metadata, ())
    with refusing(ModelError, words):
        predict(grey(), row_of_cameras(2, 16, 24), NEAR, FAR, graph)


@pytest.mark.parametrize(
    ("replaced", "words"),
    [
        ({"layer1_K": np.ones((2, 2), np.float32)}, "'layer1_K' 2"),
        ({"layer1_K": 0.0}, "K"),
        ({"opacities": np.zeros((2, 8, 8), np.float32)}, "opacities"),
        ({"means": np.ones((2, 8, 8, 3), np.float32)}, "means"),
        ({name: np.ones((2, 8, 8, *map(abs, tail)), np.float32) for name, tail in FIELDS.items()}, "8 24x16"),
        ({"sh": np.ones((2, 16, 24, 5, 3), np.float32)}, "sh"),
    ],
)
def test_outputs_that_are_no_scene_are_the_networks_fault(replaced, words):
    graph, _ = plane_graph(**replaced)
    with refusing(ModelError, words):
        predict(grey(), row_of_cameras(2, 16, 24), NEAR, FAR, graph)


def test_a_layer_without_intrinsics_is_the_networks_fault():
    graph, session = plane_graph()
    graph = Graph("plane", session, graph.metadata, graph.output_names[:-1])
    with refusing(ModelError, "'layer1_K'"):
        predict(grey(), row_of_cameras(2, 16, 24), NEAR, FAR, graph)
