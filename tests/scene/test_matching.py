"""Which photo a view was taken as: by place and turn, against the reach of all views."""

from __future__ import annotations

from pathlib import Path

import pytest
from scenes import camera_at

from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.matching import taken_as
from tinysplat_runtime.scene.scenes import Frame, Scene


def scene_of(*cameras: Camera) -> Scene:
    return Scene(Path("desk"), tuple(Frame(camera, Path(f"{n}.png")) for n, camera in enumerate(cameras)))


def test_a_view_is_the_nearest_photo_that_stands_at_its_place_and_is_turned_alike() -> None:
    """Of a reach of 10."""
    photos = scene_of(camera_at(5), camera_at(0.002, turn=1e-4), camera_at(0.0, turn=0.01), camera_at(0, -0.001))
    assert taken_as(camera_at(0), photos, 10) == (3, 2, 0.0)
    assert taken_as(camera_at(0), scene_of(camera_at(5), camera_at(0.002, turn=1e-4)), 10)[0] == 1
    assert taken_as(camera_at(0), scene_of(camera_at(5), camera_at(0.1)), 10) == (None, 1, pytest.approx(0.1))
    assert taken_as(camera_at(0), scene_of(camera_at(0, turn=-0.01), camera_at(1)), 10) == (None, 0, 0.0)
    assert taken_as(camera_at(5), photos, 0)[0] == 0
