"""Automatic choice of views: covers the scene, with baselines that stereo can use."""

import numpy as np
import pytest
from scenes import camera_at, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.spacing import Spacing, angle_between
from tinysplat_runtime.scene.viewchoice import choose_views, needed_views


def test_two_views_of_a_row_stand_at_a_stereo_baseline() -> None:
    cameras = [camera_at(0.05 * i) for i in range(40)]  # 2 units in all, the scene 3 to 5 away
    first, second = choose_views(cameras, 3.0, 5.0, 2)
    assert 0.02 < 0.05 * (second - first) / 4 < 0.5


def test_views_of_two_places_cover_both() -> None:
    here = [camera_at(0.2 * i) for i in range(4)]
    there = [camera_at(0.2 * i, turn=np.pi) for i in range(4)]  # looking the other way
    chosen = choose_views([*here, *there], 2.0, 4.0, 4)
    assert sum(i < 4 for i in chosen) == 2


def test_the_choice_does_not_depend_on_the_scene_s_unit() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(-1, 1, 12)
    small = choose_views([camera_at(x) for x in places], 2.0, 6.0, 3)
    large = choose_views([camera_at(1000 * x) for x in places], 2000.0, 6000.0, 3)
    assert small == large == sorted(set(small)) and len(small) == 3


@pytest.mark.parametrize("count", [1, 4])
def test_impossible_numbers_are_refused(count: int) -> None:
    with refusing(InputError, f"{count} of 3 2"):
        choose_views([camera_at(0.1 * i) for i in range(3)], 1.0, 2.0, count)


def test_photos_of_one_place_are_refused() -> None:
    with refusing(InputError, "views:"):
        choose_views([camera_at(0.0, turn=0.1 * i) for i in range(3)], 1.0, 2.0, 2)


def row(count: int, step: float) -> list[Camera]:
    """`count` cameras `step` apart, the scene at a depth of 4."""
    return [camera_at(step * i) for i in range(count)]


NEAR, FAR = 3.0, 6.0  # whose harmonic mean is 4


def test_a_capture_keeps_what_lies_apart_and_leaves_out_what_lies_between() -> None:
    assert needed_views(row(9, 0.8), NEAR, FAR) == list(range(9))
    kept = needed_views(row(181, 0.01), NEAR, FAR)
    assert len(kept) < 90 and kept[0] == 0 and kept[-1] == 180
    assert np.diff(kept).max() <= 2 * np.diff(kept).min()


def test_so_many_are_kept_as_are_asked_for_and_they_are_spread() -> None:
    kept = needed_views(row(100, 0.05), NEAR, FAR, 10)
    assert len(kept) == 10 and np.diff(kept).max() <= 2 * np.diff(kept).min() + 1
    assert needed_views(row(12, 0.05), NEAR, FAR, 40) == list(range(12))


def test_blurred_photos_give_way_to_sharper_ones_beside_them() -> None:
    cameras = row(60, 0.05)
    any_kept = needed_views(cameras, NEAR, FAR, 8)
    assert any(i % 3 == 0 for i in any_kept)
    kept = needed_views(cameras, NEAR, FAR, 8, lambda i: 1.0 if i % 3 else 0.5)
    assert all(i % 3 for i in kept) and len(kept) == 8 and np.diff(kept).max() <= np.diff(any_kept).max() + 3


def arc(count: int, step: float) -> list[Camera]:
    """`count` cameras, `step` degrees apart, around a point 4 away that all look at."""
    cameras = []
    for i in range(count):
        angle = np.radians(step * i)
        c2w = np.eye(4)
        c2w[:3, :3] = [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
        c2w[:3, 3] = [4 * np.sin(angle), 0, -4 * np.cos(angle)]
        cameras.append(Camera([[100.0, 0, 64], [0, 100, 48], [0, 0, 1]], c2w, 128, 96))
    return cameras


@pytest.mark.parametrize(("count", "step"), [(10, 15.0), (36, 10.0), (20, 8.0)])
@pytest.mark.parametrize("wanted", [3, 4, 6])
def test_no_gap_is_left_that_photos_between_could_fill(count: int, step: float, wanted: int) -> None:
    cameras = arc(count, step)
    chosen = choose_views(cameras, 2.0, 6.0, wanted)
    assert len(chosen) == wanted
    assert Spacing.of([cameras[i] for i in chosen], 2.0, 6.0).largest < 60


def test_how_far_apart_photos_are() -> None:
    cameras = arc(6, 12.0)
    for i in range(5):
        assert angle_between(cameras[i], cameras[i + 1], 3.99, 4.01) == pytest.approx(12, abs=1.5)
    away = [camera_at(0.0, turn=np.pi)]
    spacing = Spacing.of([*arc(6, 12.0), *away], 3.99, 4.01)
    assert 10 < spacing.typical <= spacing.largest < 13
    assert spacing.alone == (6,)
    said = spacing.said([f"{i}.jpg" for i in range(7)])
    assert tells(said, "11° 3° 10° 35° 6.jpg")
    gap = Spacing.of([arc(6, 12.0)[i] for i in (0, 1, 2, 5)], 3.99, 4.01)
    assert gap.farthest == (2, 3) and gap.largest == pytest.approx(36, abs=4)


def test_spacing_does_not_depend_on_the_unit_nor_on_the_order() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(-1, 1, 9)
    small = Spacing.of([camera_at(x) for x in places], 2.0, 6.0)
    large = Spacing.of([camera_at(1000 * x) for x in places[::-1]], 2000.0, 6000.0)
    assert small.typical == pytest.approx(large.typical) and small.largest == pytest.approx(large.largest)
    assert sorted(8 - v for v in large.farthest) == list(small.farthest)
    assert np.isnan(Spacing.of([camera_at(0.0), camera_at(0.0, turn=np.pi)], 2.0, 6.0).typical)
