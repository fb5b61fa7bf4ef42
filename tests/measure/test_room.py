"""The room and the motorcycle pair stay what committed figures were measured on, and write themselves as scenes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fingerprints import print_of

import tinysplat_runtime as ts
from tinysplat.measure.subjects import room
from tinysplat.measure.subjects.cases import Window
from tinysplat.measure.subjects.room import Motorcycle, Room, between_cameras, room_cameras

WINDOW = Window("any", (0,), (1,))
CLOSE = {"rel": 3e-6}


@pytest.mark.parametrize(
    ("position", "photo", "depth"),
    [
        (-2.5, (0.38065155, 0.38042093), (5.6649598, 5.6686671)),
        (0.0, (0.38338141, 0.38334145), (5.6581442, 5.6554707)),
        (1.5, (0.38311891, 0.3833513), (5.6959453, 5.7012483)),
    ],
)
def test_photos_and_depths_of_the_room_are_what_they_were(position: float, photo, depth) -> None:
    pictures = room.photograph(room._camera(position, 40, 56))
    assert [one.dtype for one in pictures] == [np.float32] * 2
    assert print_of(pictures[0]) == pytest.approx(photo, **CLOSE)
    assert print_of(pictures[1]) == pytest.approx(depth, **CLOSE)


@pytest.mark.parametrize(("height", "width"), [(12, 20), (20, 12)])
def test_cameras_stand_a_fifth_apart_on_an_arc_and_look_at_its_middle(height: int, width: int) -> None:
    for views in (1, 2, 3, 6):
        places = np.arange(views) - (views - 1) / 2
        step = np.arange(1, 4) / 4
        middle = [places[views // 2 - 1] + at for at in step] if views > 1 else [at - 0.5 for at in step]
        for cameras, positions in (
            (room_cameras(views, height, width), places),
            (between_cameras(views, height, width), middle),
        ):
            assert len(cameras) == len(positions)
            for camera, position in zip(cameras, positions, strict=True):
                x = 0.2 * position
                np.testing.assert_allclose(camera.centre, [x, 0.05 * np.sin(3 * position) - 0.1, x * x / 50])
                np.testing.assert_allclose(camera.c2w[:3, 2], [-np.sin(x / 5), 0, np.cos(x / 5)], atol=1e-12)
                np.testing.assert_allclose(camera.c2w[:3, 1], [0, 1, 0])
                np.testing.assert_allclose(camera.K, [[18, 0, width / 2], [0, 18, height / 2], [0, 0, 1]])
                assert (camera.height, camera.width) == (height, width)
    assert len(between_cameras(2, height, width, 5)) == 5
    assert between_cameras(2, 8, 8, 1)[0].centre[0] == 0


def test_the_room_is_seen_from_its_cameras_and_between_the_middle_pair(tmp_path: Path) -> None:
    shots = Room(3).shots(WINDOW, (16, 24))
    assert (shots.near, shots.far) == (1.8, 9.0)
    assert print_of(shots.context.images) == pytest.approx((0.3794141, 0.37975455), **CLOSE)
    assert print_of(shots.targets.images) == pytest.approx((0.37641713, 0.3762473), **CLOSE)
    assert print_of(shots.targets.depths) == pytest.approx((5.8193651, 5.7993869), **CLOSE)
    assert Room().windows() == ([Window("room", (0,), (1,))], [])
    assert (Room().name, Room().fingerprint(WINDOW), Motorcycle().fingerprint(WINDOW)) == ("room", "room", "motorcycle")
    Room(3).write(tmp_path, (16, 24))
    scene = ts.load_scene(tmp_path)
    assert (scene.near, scene.far) == (1.8, 9.0) and len(scene.frames) == 3
    assert np.abs(scene.images() - shots.context.images).max() <= 0.5 / 255 + 1e-6
    for one, other in zip(scene.cameras, shots.context.cameras, strict=True):
        np.testing.assert_allclose(one.c2w, other.c2w)
        np.testing.assert_allclose(one.K, other.K)
    assert len(json.loads((tmp_path / "cameras.json").read_text())["frames"]) == 3


def test_the_motorcycle_is_a_pair_19_cm_apart_with_depth_of_the_left_one() -> None:
    shots = Motorcycle().shots(WINDOW, (50, 70))
    left, right = shots.context.cameras
    np.testing.assert_array_equal(right.centre - left.centre, [0.193001, 0, 0])
    assert (shots.near, shots.far, len(shots.targets.images)) == (2.0, 5.1, 0)
    assert print_of(shots.context.images) == pytest.approx((0.42489038, 0.42469486), **CLOSE)
    depth, nothing = shots.context.depths
    assert nothing is None and print_of(depth) == pytest.approx((2.9155978, 2.9264082), **CLOSE)
    # 741×500 covers 70×50 by a tenth and cuts off the sides
    assert left.K[0, 0] == left.K[1, 1] == pytest.approx(99.4978)
    assert right.K[0, 2] - left.K[0, 2] == pytest.approx((342.279 - 311.193) / 10)
    assert left.K[1, 2] == pytest.approx(25.4877)
    full = room._motorcycle()[1]
    assert full.shape == (500, 741) and print_of(full) == pytest.approx((2.9063209, 2.9065139), **CLOSE)
    assert (full == 0).any()


def test_depth_at_another_size_is_the_nearest_and_no_mean() -> None:
    camera = ts.Camera([[8, 0, 4], [0, 8, 3], [0, 0, 1]], np.eye(4), 8, 6)
    depth = np.arange(48.0).reshape(6, 8)
    np.testing.assert_array_equal(room._nearest(depth, camera, camera), depth)
    small = ts.Camera([[4, 0, 2], [0, 4, 1.5], [0, 0, 1]], np.eye(4), 4, 3)
    np.testing.assert_array_equal(room._nearest(depth, camera, small), depth[1::2, 1::2])
    wide = ts.Camera([[8, 0, 6], [0, 8, 5], [0, 0, 1]], np.eye(4), 12, 10)
    rows, columns = np.clip(np.arange(10) - 2, 0, 5), np.clip(np.arange(12) - 2, 0, 7)
    np.testing.assert_array_equal(room._nearest(depth, camera, wide), depth[rows][:, columns])
