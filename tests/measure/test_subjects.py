"""Made-up scenes and peak memory: what studies stand on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import tinysplat_runtime as ts
from tinysplat.measure.clock import measure_peak
from tinysplat.measure.pictures import Drawing, photo_psnr, rescaled
from tinysplat.measure.subjects.cases import Window
from tinysplat.measure.subjects.made import made_gaussians
from tinysplat.measure.subjects.room import Room, photograph, room_cameras
from tinysplat_runtime.errors import TinySplatError


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
    assert photo_psnr(gaussians, gaussians.cameras, photos.images, Drawing()) > 20


def test_rescaling_keeps_a_ramp() -> None:
    ramp = np.arange(8.0)[:, None, None] * np.ones((1, 6, 3))
    double = rescaled(ramp, 16, 12)
    assert double.shape == (16, 12, 3)
    assert np.allclose(double[4:-4, 0, 0], np.arange(3, 11) / 2 + 0.25, atol=1e-5)


def test_peak_memory_grows_with_the_input_and_not_with_the_parent(tmp_path: Path) -> None:
    ballast = np.ones(30_000_000)  # 240 MB that a child must not inherit
    task = "tinysplat.measure.studies.growth.draw_cloud"
    small, large = (measure_peak(task, tmp_path, count, 16, 16, "numpy", 1) for count in (500, 300_000))
    assert small.total < ballast.nbytes
    assert large.total > small.total + 5_000_000


def test_a_child_that_fails_says_why(tmp_path) -> None:
    with pytest.raises(TinySplatError, match="missing"):
        measure_peak("tinysplat.measure.studies.growth.encode_photos", tmp_path / "missing", 1)


def test_the_room_written_as_a_scene_is_the_room(tmp_path: Path) -> None:
    shots = Room(3).shots(Window("any", (0,), (1,)), (16, 24))
    Room(3).write(tmp_path, (16, 24))
    scene = ts.load_scene(tmp_path)
    assert (scene.near, scene.far) == (shots.near, shots.far) and len(scene.frames) == 3
    assert np.abs(scene.images() - shots.context.images).max() <= 0.5 / 255 + 1e-6
    for one, other in zip(scene.cameras, shots.context.cameras, strict=True):
        np.testing.assert_allclose(one.c2w, other.c2w)
        np.testing.assert_allclose(one.K, other.K)
    assert len(json.loads((tmp_path / "cameras.json").read_text())["frames"]) == 3
