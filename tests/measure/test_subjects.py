"""Made-up scenes: what studies stand on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import tinysplat_runtime as ts
from tinysplat.measure.subjects.cases import Window
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


def test_a_room_written_as_a_scene_is_the_room(tmp_path: Path) -> None:
    shots = Room(3).shots(Window("any", (0,), (1,)), (16, 24))
    shots.write(tmp_path)
    scene = ts.load_scene(tmp_path)
    assert (scene.near, scene.far) == (shots.near, shots.far) and len(scene.frames) == 3
    assert np.abs(scene.images() - shots.context.images).max() <= 0.5 / 255 + 1e-6
    for one, other in zip(scene.cameras, shots.context.cameras, strict=True):
        np.testing.assert_allclose(one.c2w, other.c2w)
        np.testing.assert_allclose(one.K, other.K)
