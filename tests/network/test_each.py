"""Photo by photo: every photo is read once and shown where it was taken, whatever their order, place and size."""

from collections.abc import Sequence

import numpy as np
import pytest
from networks.two_planes import FAR, NEAR, TracedScene, scene_of, trace
from numpy.typing import NDArray
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.network.each import predict_each
from tinysplat_runtime.network.predict import FAR_FROM_ORIGIN, NetworkLimits
from tinysplat_runtime.network.walk import capture_groups
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.neighbours import Group

STAGES = GraphStore(threads=1).stages("edge")
VIEWS = 7


@pytest.fixture(scope="module")
def scene() -> TracedScene:
    return trace(VIEWS, 50, 70)  # sides that the stride does not divide


def groups(cameras: Sequence[Camera]) -> tuple[Group, ...]:
    return capture_groups(cameras, NEAR, FAR, NetworkLimits())


def depths(gaussians: Gaussians, camera: Camera, view: int) -> NDArray:
    """z of a view's means."""
    return (gaussians.means[view] + gaussians.origin - camera.centre) @ camera.rotation[2]


def check_depths(gaussians: Gaussians, scene: TracedScene, order: Sequence[int]) -> None:
    for place, v in enumerate(order):
        error = np.abs(depths(gaussians, gaussians.cameras[place], place) / scene.depth[v] - 1)
        assert np.median(error) < 0.02, v


def test_photos_may_come_in_any_order(scene: TracedScene) -> None:
    order = [3, 0, 6, 1, 5, 2, 4]
    cameras = [scene.cameras[v] for v in order]
    found = predict_each(scene_of(scene.images[order], cameras), STAGES, groups(cameras))
    check_depths(found, scene, order)


def test_a_place_far_from_the_origin_is_as_exact(scene: TracedScene) -> None:
    shift = np.array([10 * FAR_FROM_ORIGIN * NEAR, 0, 0])
    moved = []
    for camera in scene.cameras:
        c2w = camera.c2w.copy()
        c2w[:3, 3] += shift
        moved.append(Camera(camera.K, c2w, camera.width, camera.height))
    found = predict_each(scene_of(scene.images, moved), STAGES, groups(moved))
    assert np.linalg.norm(found.origin) > FAR_FROM_ORIGIN * NEAR
    check_depths(found, scene, range(VIEWS))


def test_a_photo_that_is_no_picture_is_refused(scene: TracedScene) -> None:
    bad = scene.images.copy()
    bad[2, 0, 0] = np.nan
    with refusing(InputError, "images[2]"):
        predict_each(scene_of(bad, scene.cameras), STAGES, groups(scene.cameras))
