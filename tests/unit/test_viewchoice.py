"""Automatic choice of views: covers the scene, with baselines that stereo can use."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.viewchoice import choose_views

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
