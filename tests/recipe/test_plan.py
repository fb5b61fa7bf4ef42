"""What `encode` says that photos will take: every step that follows, and how they grow."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest
from networks.two_planes import row_of_cameras, trace, write_traced
from scenes import Heard

import tinysplat_runtime as ts
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.recipe.encode import encode
from tinysplat_runtime.recipe.plan import Plan, planned
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.scene.scenes import Frame, Scene


def photos(count: int, height: int, width: int) -> Scene:
    """Photos that are never opened."""
    frames = [Frame(camera, Path(f"{i}.png")) for i, camera in enumerate(row_of_cameras(count, height, width))]
    return Scene(Path("made"), tuple(frames), 1.0, 2.0)


def plan(scene: Scene, *, is_refined: bool = True, is_usual: bool = True, cores: int = 2) -> Plan:
    return planned(scene, is_refined=is_refined, is_usual=is_usual, cores=cores)


def test_a_plan_names_what_takes_long_and_says_the_size_where_it_is_known() -> None:
    scene = photos(24, 256, 256)
    whole = plan(scene)
    assert whole.total == pytest.approx(sum(whole.seconds.values()))
    assert whole.total > plan(scene, is_refined=False).total
    assert all(name in str(whole) for name, seconds in whole.seconds.items() if seconds > whole.total / 5)
    assert "KB" in str(whole) and "KB" not in str(plan(scene, is_usual=False))


def test_more_photos_larger_ones_and_fewer_cores_take_longer() -> None:
    for series in (
        [plan(photos(count, 256, 256)) for count in (7, 24, 100)],
        [plan(photos(24, side, side)) for side in (64, 256, 640, 2000)],
        [plan(photos(24, 256, 256), cores=cores) for cores in (8, 2, 1)],
    ):
        assert all(less.total < more.total for less, more in pairwise(series))


def test_the_network_is_given_large_photos_in_small() -> None:
    """So pixels beyond 640·480 take less."""
    small, middle, large = (plan(photos(24, side, side)).total for side in (400, 550, 1000))
    assert (large - middle) / (1000**2 - 550**2) < (middle - small) / (550**2 - 400**2)


def test_reading_files_larger_than_what_the_network_gets_is_in_the_plan() -> None:
    small, scaled = photos(24, 256, 256), photos(24, 3000, 3000).resized(256, 256)
    assert plan(scaled).total > plan(small).total


def test_what_runs_before_the_network_is_counted(tmp_path: Path) -> None:
    heard = Heard()
    scene = ts.load_scene(write_traced(tmp_path, trace(7, 32, 32, spacing=0.25, subpixels=1)))
    encode(EncodeRequest(scene, model="sweep", mode="photos"), Runtime(threads=1), heard)
    assert len(heard.passed) > 1 and any(re.search(r"\d s", line) for line in heard.lines)
