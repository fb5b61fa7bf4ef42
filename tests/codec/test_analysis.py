"""The host's side of VPT: camera centres in two parts, one sign for all quaternions, rotations relative to a view's."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians, refusing
from scipy.spatial.transform import Rotation

from tinysplat_runtime.codec.analysis import ProjectedLayer, project_layer
from tinysplat_runtime.errors import NumericError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore

STORE = GraphStore(threads=1)


def _project(layer: Gaussians) -> ProjectedLayer:
    return project_layer(STORE, layer, drop_invalid=False, where="layer 0")


def _seen_by_its_camera(layer: Gaussians, view: int) -> Rotation:
    """Rotations of a view's Gaussians in its camera's frame, rows of pixels one after the other."""
    world = Rotation.from_quat(layer.quats[view].reshape(-1, 4).astype(np.float64), scalar_first=True)
    return Rotation.from_matrix(layer.cameras[view].rotation) * world


@pytest.fixture(scope="module")
def layer() -> Gaussians:
    """Gaussians of any rotation, of either sign, before turned cameras."""
    scene = make_smooth_gaussians(3, 14, 18, 0, seed=2)
    lean = np.array([0.3, -0.8, 0.5, 0.1])
    quats = lean + 0.35 * np.random.default_rng(0).standard_normal(scene.quats.shape)
    quats[np.random.default_rng(1).random(quats.shape[:3]) < 0.4] *= -1
    return replace(scene, quats=quats)


def test_rotations_are_those_in_the_camera_s_frame(layer):
    planes = _project(layer).planes(PlaneClass.ROTATION)
    for view in range(3):
        found = Rotation.from_quat(planes[view].reshape(4, -1).T, scalar_first=True)
        assert (found.inv() * _seen_by_its_camera(layer, view)).magnitude().max() < 1e-5


def test_all_quaternions_of_a_view_have_the_sign_of_its_dominant_one(layer):
    projected = _project(layer)
    planes = projected.planes(PlaneClass.ROTATION)
    for view in range(3):
        q = _seen_by_its_camera(layer, view).as_quat(scalar_first=True)
        dominant = np.linalg.eigh(q.T @ q)[1][:, -1]
        dominant *= np.sign(dominant[np.abs(dominant).argmax()])
        np.testing.assert_allclose(projected.reference_quats[view], dominant, atol=1e-5)
        assert np.einsum("c,chw->hw", dominant, planes[view]).min() >= 0


@pytest.mark.parametrize("distance", [1e2, 1e4])
def test_depths_keep_float32_where_cameras_stand_far_from_the_origin(distance):
    """A camera's centre takes two float32 there: with the first alone, depths are as wrong as it is rounded."""
    place = distance * np.array([1.0, -0.7, 0.4])
    scene = make_smooth_gaussians(2, 10, 12, 0, origin=place)
    moved = replace(scene, means=(scene.means.astype(np.float64) + place).astype(np.float32), origin=np.zeros(3))
    found = _project(moved).planes(PlaneClass.DEPTH)[:, 0]
    for view, camera in enumerate(moved.cameras):
        wanted = ((moved.means[view].astype(np.float64) - camera.centre) @ camera.rotation.T)[..., 2]
        np.testing.assert_allclose(found[view], wanted, rtol=1e-6)


def _behind(layer: Gaussians, view: int, count: int) -> Gaussians:
    """The layer with the first `count` Gaussians of a view moved behind its camera."""
    camera, means = layer.cameras[view], layer.means.copy()
    means[view, 0, :count] = camera.centre - 2 * camera.c2w[:3, 2]
    return replace(layer, means=means)


@pytest.mark.parametrize(("view", "count"), [(0, 1), (1, 3), (2, 1), (2, 2)])
def test_gaussians_behind_their_camera_are_counted_and_their_view_is_named(layer, view, count):
    with refusing(NumericError, f"layer 0 view {view}: {count}"):
        _project(_behind(layer, view, count))


def test_what_is_dropped_is_transparent_and_otherwise_its_view_s_median(layer):
    wanted, changed = _project(layer).geometry, _behind(layer, 1, 3)
    found = project_layer(STORE, changed, drop_invalid=True, where="layer 0").geometry
    kept = np.ones(layer.opacities.shape, bool)
    kept[1, 0, :3] = False
    np.testing.assert_allclose(found[1][:, kept[1]], wanted[1][:, kept[1]], atol=1e-6)
    np.testing.assert_array_equal(found[0], wanted[0])
    assert not found[1, 10, 0, :3].any()
    for channel in range(6):  # rotations may have turned their sign
        np.testing.assert_allclose(found[1, channel, 0, :3], np.median(wanted[1, channel][kept[1]]), rtol=1e-5)


def test_gaussians_all_behind_their_cameras_are_refused_even_where_some_may_be_dropped(layer):
    turned = [replace(camera, c2w=camera.c2w @ np.diag([-1.0, 1, -1, 1])) for camera in layer.cameras]
    with refusing(NumericError, "layer 0"):
        project_layer(STORE, replace(layer, cameras=tuple(turned)), drop_invalid=True, where="layer 0")
