"""Photos that memory does not suffice for are refused before work begins, with what would fit."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scenes import make_gaussians, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.recipe.memory import check_memory
from tinysplat_runtime.recipe.own import looked_at, near_of, own_psnr
from tinysplat_runtime.scene.scenes import Frame, Scene

Says = Callable[..., None]


def capture(count: int, height: int, width: int) -> Scene:
    camera = ts.Camera([[50, 0, 20], [0, 50, 20], [0, 0, 1]], np.eye(4), width, height)
    return Scene(Path("capture"), tuple(Frame(camera, Path(f"{i}.png")) for i in range(count)), 1.0, 2.0)


def needed(scene: Scene, free_memory: Says, **options: object) -> float:
    """The least number of gigabytes, to a hundredth, with which a scene is taken."""
    low, high = 0.0, 400.0
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        free_memory(int(middle * 1e9))
        try:
            check_memory(scene, **options)  # type: ignore[arg-type]
        except ts.InputError:
            low = middle
        else:
            high = middle
    return high


def test_what_is_taken_grows_with_pixels_and_photos_and_with_what_is_done(free_memory: Says) -> None:
    by_size = [needed(capture(2, side, side), free_memory) for side in (256, 512, 1024)]
    by_count = [needed(capture(count, 480, 640), free_memory) for count in (2, 4, 6)]
    captures = [needed(capture(count, 480, 640), free_memory) for count in (20, 100, 400)]
    plain = needed(capture(40, 480, 640), free_memory)
    assert all(less < more for found in (by_size, by_count) for less, more in pairwise(found))
    assert all(less <= more for less, more in pairwise(captures))
    assert needed(capture(40, 480, 640), free_memory, refined=True) >= plain
    assert needed(capture(8, 480, 640), free_memory, each=True) < needed(capture(8, 480, 640), free_memory)


@pytest.mark.skipif(sys.platform != "linux", reason="arrays lie on disk on Linux alone")
def test_of_a_capture_that_fits_on_the_disk_memory_holds_little(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free_memory: Says
) -> None:
    few, many = capture(20, 240, 320), capture(100, 240, 320)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    for refined in (False, True):
        monkeypatch.setenv("TMPDIR", str(tmp_path))
        on_disk = needed(many, free_memory, each=True, refined=refined)
        assert on_disk < 1.2 * needed(few, free_memory, each=True, refined=refined)
        monkeypatch.setenv("TMPDIR", str(tmp_path / "missing"))
        assert needed(many, free_memory, each=True, refined=refined) > 2 * on_disk
    assert needed(many, free_memory, each=True, refined=True) > 1.5 * needed(many, free_memory, each=True)


@pytest.mark.parametrize("count", [2, 6, 100])
def test_nothing_is_taken_on_that_needs_more_than_is_free(count: int, free_memory: Says) -> None:
    scene = capture(count, 1000, 1500)
    enough = needed(scene, free_memory)
    free_memory(int(0.98 * enough * 1e9))
    with pytest.raises(ts.InputError) as caught:
        check_memory(scene)
    said = re.search(r"take about ([\d.]+) GB", str(caught.value))
    assert said and float(said[1]) <= enough


@pytest.mark.parametrize("count", [2, 6, 100])
def test_the_size_that_is_told_fits(count: int, free_memory: Says) -> None:
    scene = capture(count, 1000, 1500)
    free_memory(int(needed(scene, free_memory) * 0.5e9))
    with pytest.raises(ts.InputError, match=f"^capture: {count} photos of 1500x1000") as caught:
        check_memory(scene)
    found = re.search(r"--size (\d+)x(\d+)", str(caught.value))
    assert found
    width, height = int(found[1]), int(found[2])
    assert width / height == pytest.approx(1.5, abs=0.05) and height > 300
    check_memory(capture(count, height, width))


def test_no_size_is_told_where_none_would_do(free_memory: Says) -> None:
    free_memory(10_000_000)
    with pytest.raises(ts.InputError) as caught:
        check_memory(capture(2, 1000, 1500))
    assert "--size" not in str(caught.value)


def test_a_system_that_tells_no_free_memory_refuses_nothing(free_memory: Says) -> None:
    free_memory(None)
    check_memory(capture(6, 5000, 5000))


def test_a_capture_is_held_against_some_of_its_photos() -> None:
    views = looked_at(100)
    assert len(views) < 20 and (views[0], views[-1]) == (0, 99) and np.ptp(np.diff(views)) <= 1
    gaussians = make_gaussians(7)
    pictures = np.stack([ts.render(gaussians, gaussians.cameras[v]) for v in (1, 5)])
    seen = [gaussians.cameras[v] for v in (1, 5)]
    assert own_psnr(lambda _: gaussians, seen, pictures, None) == pytest.approx(150)
    assert own_psnr(lambda _: gaussians, seen[::-1], pictures, None) < 60


def test_a_look_at_a_capture_decodes_the_views_about_a_camera() -> None:
    runtime, gaussians = ts.Runtime(), make_smooth_gaussians(12)
    data = runtime.compress(gaussians)
    for view in (0, 11):
        found = near_of(data, 12, runtime, "edge")(gaussians.cameras[view])
        assert gaussians.cameras[view].c2w.tolist() in [camera.c2w.tolist() for camera in found.cameras]
        assert len(found.cameras) < 12
    few = runtime.compress(make_smooth_gaussians(6))
    assert len(near_of(few, 6, runtime, "edge")(gaussians.cameras[0]).cameras) == 6
