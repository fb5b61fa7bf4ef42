"""Made-up scenes: what studies stand on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tinysplat_runtime as ts
from tinysplat.measure.pictures import photo_psnr, rescaled
from tinysplat.measure.subjects.cases import Window
from tinysplat.measure.subjects.made import cloud, made_gaussians
from tinysplat.measure.subjects.room import Room, photograph, room_cameras


def test_depths_of_the_room_agree_between_views() -> None:
    cameras = room_cameras(2, 48, 64)
    (photo, depth), (shown, other) = (photograph(camera) for camera in cameras)
    y, x = np.mgrid[:48, :64] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cameras[0].K).T
    world = (rays * depth[..., None]) @ cameras[0].rotation + cameras[0].centre
    seen = (world - cameras[1].centre) @ cameras[1].rotation.T
    pixel = (seen @ cameras[1].K.T)[..., :2] / seen[..., 2:]
    inside = ((pixel > 0) & (pixel < [64, 48])).all(axis=-1)
    column, row = pixel[inside].astype(int).T
    error = np.abs(other[row, column] - seen[inside][:, 2]) / seen[inside][:, 2]
    assert np.median(error) < 5e-3  # half a pixel of a slanted wall; more where one view sees what the other does not
    assert np.mean(error < 0.03) > 0.9 and np.median(np.abs(shown[row, column] - photo[inside])) < 0.03


def test_network_like_gaussians_show_their_photos() -> None:
    gaussians, photos = made_gaussians(2, 64, 64, 1), Room(2).shots(Window("any", (0,), (1,)), (64, 64)).context
    shown = [photo_psnr(gaussians, gaussians.cameras, images) for images in (photos.images, photos.images[::-1])]
    assert shown[0] > shown[1]


def test_rescaling_keeps_a_ramp() -> None:
    ramp = np.arange(8.0)[:, None, None] * np.ones((1, 6, 3))
    double = rescaled(ramp, 16, 12)
    assert double.shape == (16, 12, 3)
    assert np.allclose(double[4:-4, 0, 0], np.arange(3, 11) / 2 + 0.25, atol=1e-5)


def test_clouds_are_as_deep_however_many_points_they_have() -> None:
    few, many = (cloud(count) for count in (4000, 16_000))
    areas = [float(np.mean(one.scales[:, 0] * one.scales[:, 1])) * one.count for one in (few, many)]
    assert areas[0] == pytest.approx(areas[1], rel=0.1)


def test_a_room_written_as_a_scene_is_the_room(tmp_path: Path) -> None:
    shots = Room(3).shots(Window("any", (0,), (1,)), (16, 24))
    shots.write(tmp_path)
    scene = ts.load_scene(tmp_path)
    assert (scene.near, scene.far) == (shots.near, shots.far) and len(scene.frames) == 3
    assert np.abs(scene.images() - shots.context.images).max() <= 0.5 / 255 + 1e-6
    for one, other in zip(scene.cameras, shots.context.cameras, strict=True):
        np.testing.assert_allclose(one.c2w, other.c2w)
        np.testing.assert_allclose(one.K, other.K)
