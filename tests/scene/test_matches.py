"""Corners in two photos: found where they lie, matched to the same ones, and held against cameras."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import camera_at

from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.matches import depths_told, inliers

HERE, THERE = camera_at(0.0), camera_at(0.5, 0.1, turn=-0.1)
POINTS = np.random.default_rng(0).uniform((-1, -0.8, 3), (1.4, 0.8, 6), (50, 3))


def projected(points: NDArray, camera: Camera) -> tuple[NDArray, NDArray]:
    """(N, 3) pixels x, y, 1 and (N,) depths."""
    local = (points - camera.centre) @ camera.rotation.T @ camera.K.T
    return local / local[:, 2:], local[:, 2]


def places(points: NDArray, one: Camera = HERE, other: Camera = THERE) -> NDArray:
    return np.concatenate([projected(points, camera)[0] for camera in (one, other)], axis=1)


def test_places_that_cameras_project_fit_and_tell_their_depths() -> None:
    for one, other in ((HERE, THERE), (THERE, HERE)):
        both = places(POINTS, one, other)
        assert inliers(both, one, other) == pytest.approx(50, rel=1e-9)
        np.testing.assert_allclose(depths_told(both, one, other), projected(POINTS, one)[1], rtol=1e-6)
    distant = places(1e4 * POINTS)
    assert inliers(distant, HERE, THERE) == pytest.approx(50, rel=1e-6) and not depths_told(distant, HERE, THERE).size
