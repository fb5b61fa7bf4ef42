"""What captures take: a group in the network, and every pixel's Gaussians while they are coded."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

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


class Gigabytes:
    """Free memory that a test sets."""

    free = 0


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Gigabytes:
    gigabytes = Gigabytes()
    monkeypatch.setattr(memory, "available_bytes", lambda: gigabytes.free)
    return gigabytes


ENLARGER = SimpleNamespace(pixels=100_000)
MEGA = 1_000_000
LARGE = 2 * 640 * 480


@pytest.mark.parametrize(
    ("count", "size", "options", "taken"),
    [  # per photo: (350 n - 240) n bytes a pixel of n photos that a network sees at once
        (2, (1000, 1000), {}, 920 * MEGA),
        (3, (1000, 1000), {}, 2430 * MEGA),
        (6, (1000, 1000), {}, 11_160 * MEGA),
        (2, (1000, 1000), {"mode": "hybrid"}, 920 * MEGA + 460 * 2 * MEGA),
        (2, (1000, 1000), {"refined": True}, 1350 * 2 * MEGA),
        (6, (1000, 1000), {"refined": True}, 11_160 * MEGA),
        (7, (1000, 1000), {}, 4640 * MEGA),  # four at once
        (40, (1000, 1000), {}, 150 * 40 * MEGA),
        (40, (1000, 1000), {"mode": "hybrid"}, (150 + 460) * 40 * MEGA),
        (40, (1000, 1000), {"refined": True}, 1350 * 40 * MEGA),
        (2, (1000, 1000), {"enlarger": ENLARGER}, 147 * 2 * MEGA),
        (2, (480, 640), {"enlarger": ENLARGER}, 920 * LARGE // 2),
        (2, (481, 640), {"enlarger": ENLARGER}, 920 * 100_000 + 12 * 2 * 481 * 640),
        (3, (700, 700), {"enlarger": SimpleNamespace(pixels=300_000)}, 2430 * 300_000 + 12 * 3 * 490_000),
    ],
)  # fmt: skip
def test_photos_take_what_their_pixels_take_and_a_quarter_of_a_gigabyte(
    count: int, size: tuple[int, int], options: dict[str, Any], taken: int, free: Gigabytes
) -> None:
    """Nine tenths of what is free may be taken."""
    scene, wanted = capture(count, *size), (taken + 250_000_000) / 0.9
    free.free = int(wanted * 1.000001) + 1
    memory.check_memory(scene, **options)
    free.free = int(wanted * 0.999999)
    with pytest.raises(ts.InputError, match=rf"{count} photos of .* take about {(taken + 250e6) / 1e9:.1f} GB"):
        memory.check_memory(scene, **options)


def test_the_size_that_would_fit_is_the_largest_of_the_same_shape(free: Gigabytes) -> None:
    free.free = 1_000_000_000  # 650 MB for 920 bytes a pixel of one photo
    share = (650 / 920 / 1.5) ** 0.5
    with pytest.raises(ts.InputError) as caught:
        memory.check_memory(capture(2, 1000, 1500))
    said = f"2 photos of 1500x1000 take about 1.6 GB, 1.0 GB are free; --size {1000 * share:.0f}x{1500 * share:.0f}"
    assert str(caught.value) == f"capture: {said[:-8]}{int(1000 * share)}x{int(1500 * share)} would fit"
    fits = (int(1000 * share), int(1500 * share))
    memory.check_memory(capture(2, *fits))
    with pytest.raises(ts.InputError):
        memory.check_memory(capture(2, fits[0] + 2, fits[1] + 2))


@pytest.mark.parametrize(("side", "advice"), [(64.2, "--size 64x96 would fit"), (63.8, "free some first")])
def test_less_than_64_pixels_are_no_advice(side: float, advice: str, free: Gigabytes) -> None:
    free.free = round((side * side * 1.5 * 920 + 250e6) / 0.9)
    with pytest.raises(ts.InputError, match=advice):
        memory.check_memory(capture(2, 1000, 1500))


def test_a_system_that_tells_no_free_memory_refuses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    memory.check_memory(capture(6, 5000, 5000))
