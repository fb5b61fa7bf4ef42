"""What captures take: a group in the network, and every pixel's Gaussians while they are coded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scenes import make_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.recipe import memory
from tinysplat_runtime.recipe.own import looked_at, own_psnr
from tinysplat_runtime.scene.scenes import Frame, Scene


def capture(count: int, height: int, width: int) -> Scene:
    camera = ts.Camera([[50, 0, 20], [0, 50, 20], [0, 0, 1]], np.eye(4), width, height)
    return Scene(Path("capture"), tuple(Frame(camera, Path(f"{i}.png")) for i in range(count)), 1.0, 2.0)


@pytest.mark.parametrize(
    ("count", "size", "gigabytes"), [(24, (256, 256), 0.75), (100, (480, 640), 6), (100, (256, 256), 1.5)]
)
def test_a_capture_takes_a_group_and_its_gaussians(
    count: int, size: tuple[int, int], gigabytes: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: int(gigabytes * 1e9))
    memory.check_memory(capture(count, *size))
    monkeypatch.setattr(memory, "available_bytes", lambda: int(gigabytes * 0.6e9))
    with pytest.raises(ts.InputError, match=f"{count} photos of .* GB are free; --size"):
        memory.check_memory(capture(count, *size))


def test_six_photos_are_one_group_and_seven_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: 2_000_000_000)
    memory.check_memory(capture(7, 480, 640))
    with pytest.raises(ts.InputError):
        memory.check_memory(capture(6, 480, 640))


def test_a_capture_is_held_against_some_of_its_photos() -> None:
    assert looked_at(6) == list(range(6)) and looked_at(8) == list(range(8))
    views = looked_at(100)
    assert len(views) == 8 and (views[0], views[-1]) == (0, 99) and np.ptp(np.diff(views)) <= 1
    gaussians = make_gaussians(7)
    pictures = np.stack([ts.render(gaussians, gaussians.cameras[v]) for v in (1, 5)])
    assert own_psnr(gaussians, pictures, None, [1, 5]) == pytest.approx(150)
    assert own_psnr(gaussians, pictures, None, [5, 1]) < 60
