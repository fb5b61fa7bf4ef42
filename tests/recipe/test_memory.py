"""Photos that memory does not suffice for are refused before work begins, with what would fit."""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scenes import make_gaussians, refusing

import tinysplat_runtime as ts
from tinysplat_runtime.network.ways import OneByOne
from tinysplat_runtime.recipe.memory import check_memory
from tinysplat_runtime.recipe.own import looked_at, own_psnr
from tinysplat_runtime.scene.scenes import Frame, Scene

Says = Callable[..., None]
WAY = OneByOne(ts.Runtime(threads=1).store, "edge", 1)


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


@pytest.mark.skipif(sys.platform != "linux", reason="arrays lie on disk on Linux alone")
def test_of_a_capture_that_fits_on_the_disk_memory_holds_little(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free_memory: Says
) -> None:
    few, many = capture(20, 240, 320), capture(100, 240, 320)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    on_disk = needed(many, free_memory, way=WAY)
    assert on_disk < 2.5 * needed(few, free_memory, way=WAY)  # of five times as many
    monkeypatch.setenv("TMPDIR", str(tmp_path / "missing"))
    assert needed(many, free_memory, way=WAY) > on_disk


def test_photos_that_a_list_is_trained_on_count_beside_their_copies_for_the_network(free_memory: Says) -> None:
    copies, photos = capture(24, 256, 384), capture(24, 1024, 1536)
    enough = needed(copies, free_memory, way=WAY, trained_on=photos)
    assert needed(copies, free_memory, way=WAY) < enough < needed(photos, free_memory, way=WAY)
    free_memory(int(0.7e9 * enough))
    with refusing(ts.InputError, "24 1536x1024 --size") as caught:
        check_memory(copies, WAY, trained_on=photos)
    found = re.search(r"--size (\d+)x(\d+)", str(caught.value))
    assert found and int(found[1]) > 384
    check_memory(copies, WAY, trained_on=capture(24, int(found[2]), int(found[1])))


@pytest.mark.parametrize("count", [2, 6, 100])
def test_the_size_that_is_told_fits(count: int, free_memory: Says) -> None:
    scene = capture(count, 1000, 1500)
    enough = needed(scene, free_memory)
    free_memory(int(0.5e9 * enough))
    with refusing(ts.InputError, f"capture: {count} 1500x1000") as caught:
        check_memory(scene)
    found = re.search(r"--size (\d+)x(\d+)", str(caught.value))
    gigabytes = [float(number) for number in re.findall(r"([\d.]+) GB", str(caught.value))]
    assert found and max(gigabytes) > min(gigabytes) == pytest.approx(0.5 * enough, rel=0.1, abs=0.06)
    width, height = int(found[1]), int(found[2])
    assert width / height == pytest.approx(1.5, abs=0.05)
    check_memory(capture(count, height, width))


def test_no_size_is_told_where_none_would_do(free_memory: Says) -> None:
    free_memory(10_000_000)
    with pytest.raises(ts.InputError) as caught:
        check_memory(capture(2, 1000, 1500))
    assert "--size" not in str(caught.value)


def test_many_views_are_held_against_some_of_their_photos() -> None:
    views = looked_at(100)
    assert len(views) < 100 and np.diff([-1, *views, 100]).max() <= 2 * 100 / len(views)
    gaussians = make_gaussians(7)
    pictures = np.stack([ts.render(gaussians, gaussians.cameras[v]) for v in (1, 5)])
    seen = [gaussians.cameras[v] for v in (1, 5)]
    assert own_psnr(gaussians, seen, pictures, None) > 90
    assert own_psnr(gaussians, seen[::-1], pictures, None) < 60


def test_of_a_large_photo_the_middle_band_is_compared() -> None:
    gaussians, (height, width) = make_gaussians(1, 24, 72), (720, 2048)
    camera = gaussians.cameras[0].resized(height, width)
    picture = ts.render(gaussians, camera)
    band = slice(*((height + by * (1 << 20) // width) // 2 for by in (-1, 1)))
    noise = np.random.default_rng(0).normal(0, 0.05, (band.stop - band.start, width, 3)).astype(np.float32)
    photo = np.zeros_like(picture)
    photo[band] = picture[band].clip(0.2, 0.8) + noise  # nothing is like it above and below
    wanted = -10 * np.log10(np.mean((picture[band].clip(0, 1) - photo[band]) ** 2))
    assert own_psnr(gaussians, [camera], photo[None], 1) == pytest.approx(wanted, abs=0.01)
