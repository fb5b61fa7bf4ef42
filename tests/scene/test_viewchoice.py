"""Automatic choice of views: covers the scene, with baselines that stereo can use."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.frusta import points_seen, sees
from tinysplat_runtime.scene.viewchoice import (
    _beside,
    _best_addition,
    _pair_values,
    choose_views,
    needed_views,
    sharpness_of,
)

K = [[100, 0, 64], [0, 100, 48], [0, 0, 1]]


def camera_at(x: float, turn: float = 0.0) -> Camera:
    """At (x, 0, 0), turned by `turn` radians about y."""
    c2w = np.eye(4)
    c2w[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    c2w[0, 3] = x
    return Camera(K, c2w, 128, 96)


def test_two_views_of_a_row_stand_at_a_stereo_baseline() -> None:
    cameras = [camera_at(0.05 * i) for i in range(40)]  # 2 units in all, the scene 3 to 5 away
    first, second = choose_views(cameras, 3.0, 5.0, 2)
    assert 0.04 < 0.05 * (second - first) / 4 < 0.2


def test_views_of_two_places_cover_both() -> None:
    here = [camera_at(0.2 * i) for i in range(4)]
    there = [camera_at(0.2 * i, turn=np.pi) for i in range(4)]  # looking the other way
    chosen = choose_views([*here, *there], 2.0, 4.0, 4)
    assert sum(i < 4 for i in chosen) == 2


def test_a_camera_that_only_turns_adds_nothing_to_its_twin() -> None:
    cameras = [camera_at(0.0), camera_at(0.0, 0.02), camera_at(0.3), camera_at(0.0, 0.04)]
    assert 2 in choose_views(cameras, 2.0, 4.0, 2)


def test_the_choice_does_not_depend_on_the_scene_s_unit() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(-1, 1, 12)
    small = choose_views([camera_at(x) for x in places], 2.0, 6.0, 3)
    large = choose_views([camera_at(1000 * x) for x in places], 2000.0, 6000.0, 3)
    assert small == large == sorted(set(small)) and len(small) == 3


def test_hundreds_of_photos_are_thinned_and_indices_are_theirs() -> None:
    chosen = choose_views([camera_at(0.01 * i) for i in range(300)], 3.0, 5.0, 3)
    assert len(set(chosen)) == 3 and chosen[-1] > 64


@pytest.mark.parametrize("count", [1, 4])
def test_impossible_numbers_are_refused(count: int) -> None:
    with pytest.raises(InputError, match="of 3 photos, expected 2 to 3"):
        choose_views([camera_at(0.1 * i) for i in range(3)], 1.0, 2.0, count)


def test_photos_of_one_place_are_refused() -> None:
    with pytest.raises(InputError, match="no two photos see the same place from different ones"):
        choose_views([camera_at(0.0, 0.1 * i) for i in range(3)], 1.0, 2.0, 2)


def test_points_lie_in_the_middle_of_a_picture_s_cells_on_planes_of_even_inverse_depth() -> None:
    camera = camera_at(0.7, turn=0.4)
    local = (points_seen(camera, 2.0, 6.0) - camera.centre) @ camera.c2w[:3, :3]
    assert sorted(set(np.round(local[:, 2], 9))) == [2.0, 3.0, 6.0]
    for z in (2.0, 3.0, 6.0):
        u, v = (local[np.isclose(local[:, 2], z), :2] * 100 / z + [64, 48]).T
        assert sorted(zip(u.round(6).tolist(), v.round(6).tolist(), strict=True)) == [
            (column, row) for column in (16.0, 48.0, 80.0, 112.0) for row in (16.0, 48.0, 80.0)
        ]


def test_a_camera_sees_its_picture_from_half_of_near_to_twice_far() -> None:
    camera = camera_at(0.0)

    def point(u: float, v: float, z: float) -> list[float]:
        return [(u - 64) / 100 * z, (v - 48) / 100 * z, z]

    seen = [point(0.1, 0.1, 3), point(127.9, 95.9, 3), point(64, 48, 1.01), point(64, 48, 11.9)]
    unseen = [point(-0.1, 48, 3), point(128.1, 48, 3), point(64, -0.1, 3), point(64, 96.1, 3), point(64, 48, 0.99),
              point(64, 48, 12.1), point(64, 48, -3)]  # fmt: skip
    assert sees(camera, np.array(seen), 2.0, 6.0).all()
    assert not sees(camera, np.array(unseen), 2.0, 6.0).any()


def test_pairs_are_worth_what_their_rays_angles_are() -> None:
    """Nothing at 0.1 and 35 degrees, everything from 3 to 10, straight lines between."""
    cameras = [camera_at(0.0), camera_at(0.05), camera_at(0.3, -0.05), camera_at(2.0, -0.5)]
    points = np.concatenate([points_seen(camera, 2.0, 6.0) for camera in cameras])
    found = _pair_values(cameras, 2.0, 6.0)
    seen = [sees(camera, points, 2.0, 6.0) for camera in cameras]
    for i, j in np.ndindex(4, 4):
        a, b = points - cameras[i].centre, points - cameras[j].centre
        angles = np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))
        worth = np.interp(angles, [0.1, 3, 10, 35], [0, 1, 1, 0]) * (seen[i] & seen[j])
        np.testing.assert_allclose(found[i, j], worth, atol=1e-4)
    assert {0.0, 1.0} < {round(float(value), 1) for value in found.ravel()}


def _symmetric(count: int, points: int, **pairs: list[float]) -> np.ndarray:
    values = np.zeros((count, count, points), np.float32)
    for name, worth in pairs.items():
        i, j = (int(digit) for digit in name[1:])
        values[i, j] = values[j, i] = worth
    return values


def test_a_view_or_a_pair_is_added_whichever_gains_more_per_view() -> None:
    values = _symmetric(4, 3, p01=[0.5, 0.5, 0], p23=[0, 0, 0.9], p02=[0.1, 0, 0.2], p13=[0.2, 0, 0])
    nothing = np.zeros(3, np.float32)
    assert _best_addition(values, nothing, [], room=3) == [0, 1]
    reached = values[0, 1]
    assert _best_addition(values, reached, [0, 1], room=2) == [2, 3]  # 0.45 each, where 2 alone gains 0.2
    assert _best_addition(values, reached, [0, 1], room=1) == [2]
    values[0, 2] = values[2, 0] = [0.5, 0.5, 0.46]  # alone better than half of the pair's 0.9
    assert _best_addition(values, reached, [0, 1], room=2) == [2]
    values[0, 2] = values[2, 0] = [0.9, 0.1, 0.0]  # what is reached already does not count: 0.4 at most
    assert _best_addition(values, reached, [0, 1], room=2) == [2, 3]
    assert _best_addition(values, np.ones(3, np.float32), [0, 1], room=1) == [2]  # the first that is free


def row(count: int, step: float) -> list[Camera]:
    """`count` cameras `step` apart, the scene at a depth of 4."""
    return [camera_at(step * i) for i in range(count)]


NEAR, FAR = 3.0, 6.0  # whose harmonic mean is 4


def test_a_capture_keeps_what_lies_apart_and_leaves_out_what_lies_between() -> None:
    wide = 1.1 * 0.05 * 4
    assert needed_views(row(9, wide), NEAR, FAR) == list(range(9))
    cameras = row(91, wide / 10)
    kept = needed_views(cameras, NEAR, FAR)
    assert kept[0] == 0 and kept[-1] == 90
    steps = np.diff(kept) * wide / 10 / 4
    assert steps.min() >= 0.05 and steps.max() < 0.1 + 1e-9


def test_so_many_are_kept_as_are_asked_for_and_they_are_spread() -> None:
    kept = needed_views(row(100, 0.05), NEAR, FAR, 10)
    assert len(kept) == 10 and np.diff(kept).max() <= 2 * np.diff(kept).min() + 1
    assert needed_views(row(12, 0.05), NEAR, FAR, 40) == list(range(12))


def test_a_photo_that_matches_nothing_is_not_needed() -> None:
    assert needed_views([*row(8, 0.3), camera_at(900.0)], NEAR, FAR) == list(range(8))
    with pytest.raises(InputError, match="no two photos see the same place"):
        needed_views([camera_at(0.0, turn) for turn in (0.0, 0.1, 0.2)], NEAR, FAR)


def test_blurred_photos_give_way_to_sharper_ones_beside_them() -> None:
    cameras, asked = row(60, 0.05), set[int]()

    def sharpness(i: int) -> float:
        asked.add(i)
        return 1.0 if i % 3 else 0.5

    assert any(i % 3 == 0 for i in needed_views(cameras, NEAR, FAR))
    kept = needed_views(cameras, NEAR, FAR, sharpness=sharpness)
    assert all(i % 3 for i in kept) and len(kept) == len(needed_views(cameras, NEAR, FAR))
    assert needed_views(cameras, NEAR, FAR, sharpness=lambda i: 1 + i % 3 / 100) == needed_views(cameras, NEAR, FAR)
    alone = set[int]()
    needed_views(row(8, 0.5), NEAR, FAR, sharpness=lambda i: float(alone.add(i) or 1))
    assert not alone  # there is nothing to choose among


def test_blur_lowers_sharpness_and_contrast_does_not() -> None:
    image = np.random.default_rng(0).uniform(size=(40, 50, 3))
    blurred = (image + np.roll(image, 1, axis=0) + np.roll(image, 1, axis=1)) / 3
    assert sharpness_of(blurred) < 0.7 * sharpness_of(image)
    assert sharpness_of(0.3 * image + 0.2) == pytest.approx(sharpness_of(image))


def test_a_capture_has_four_photos_however_near_they_lie() -> None:
    """Ten in a row of less than a twentieth of the depth."""
    cameras = row(10, 0.012)
    kept = needed_views(cameras, NEAR, FAR)
    assert len(kept) == 4 and {0, 9} < set(kept)
    assert len(needed_views(cameras[:3], NEAR, FAR)) == 3 and len(needed_views(cameras, NEAR, FAR, 2)) == 2


def test_rivals_are_the_three_nearest_that_are_not_taken_and_lie_within_the_spacing() -> None:
    apart = np.array([0, 0.04, 0.01, 0.03, 0.02, 0.049, 0.051, 0.005])
    here = np.array([1, 1, 1, 1, 1, 1, 1, 0], bool)
    assert _beside(apart, here) == [2, 4, 3]
    assert _beside(apart[[0, 5, 6]], here[:3]) == [1]
    assert _beside(apart[[0, 2, 2, 2, 2]], here[:5]) == [1, 2, 3]


@pytest.mark.parametrize(("sharper", "changes"), [(1.24, False), (1.26, True)])
def test_a_photo_gives_way_to_one_a_quarter_sharper(sharper: float, changes: bool) -> None:
    cameras = row(60, 0.05)
    usual = needed_views(cameras, NEAR, FAR)
    found = needed_views(cameras, NEAR, FAR, sharpness=lambda i: 1.0 if i in usual else sharper)
    assert (found != usual) == changes and len(found) == len(usual)


def test_sharpness_is_the_share_of_contrast_between_neighbours() -> None:
    image = np.zeros((3, 4, 3))
    image[1, 2] = 0.3, 0.6, 0.9  # grey 0.6: of 8 pairs down two differ, and of 9 across two
    assert sharpness_of(image) == pytest.approx(0.36 * (2 / 8 + 2 / 9) / (0.36 * (1 / 12 - 1 / 144)))
    assert sharpness_of(np.full((3, 4, 3), 0.5)) == 0
