"""Corners in two photos: found where they lie, matched to the same ones, and held against cameras."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import camera_at

from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.matches import corners, depths_told, inliers, matched

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


def test_corners_of_a_shifted_picture_are_the_same_ones_shifted() -> None:
    noise = np.fft.rfft2(np.random.default_rng(1).normal(size=(160, 200)))
    y, x = np.meshgrid(np.fft.fftfreq(160), np.fft.rfftfreq(200), indexing="ij")
    smooth = np.fft.irfft2(noise * np.exp(-60 * (x**2 + y**2)), (160, 200))
    picture = np.repeat(((smooth - smooth.min()) / np.ptp(smooth))[..., None], 3, axis=-1)
    one, other = corners(picture[:-7, 5:]), corners(picture[7:, :-5])
    both = matched(one, other)
    assert len(both) > 10 and (both[:, [2, 5]] == 1).all()
    off = np.abs(both[:, 3:5] - both[:, :2] - [5, -7])
    assert np.mean(off.max(axis=1) < 0.01) > 0.9
    assert len(matched(one, corners(picture[:, ::-1]))) < 0.2 * len(both)
    swapped = corners(picture[:-7, 5:].swapaxes(0, 1)).places[:, ::-1]
    assert np.linalg.norm(swapped[:, None] - one.places, axis=-1).min(axis=1).max() < 1e-3
    blank = corners(np.full((40, 50, 3), 0.5))
    assert blank.places.shape == (0, 2) and matched(one, blank).shape == matched(blank, one).shape == (0, 6)
