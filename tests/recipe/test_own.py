"""How a scene is compared with its own photos: which photos, which rows of them, and with which Gaussians."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.recipe import own
from tinysplat_runtime.scene.cameras import Camera

HEIGHT, WIDTH = 160, 24


def wall(views: int = 1, height: int = HEIGHT) -> Gaussians:
    """Gaussians on the rays of their pixels at z = 4, told apart by their opacities; cameras at one place."""
    K = np.array([[30.0, 0, WIDTH / 2], [0, 30.0, height / 2], [0, 0, 1]])
    c2w = np.eye(4)
    c2w[:3, 3] = 1, 2, 3
    y, x = np.mgrid[:height, :WIDTH] + 0.5
    rays = np.stack([(x - WIDTH / 2) / 30, (y - height / 2) / 30, np.ones_like(x)], axis=-1)
    lead = (views, height, WIDTH)
    return Gaussians(
        np.broadcast_to(rays * 4 + c2w[:3, 3], (*lead, 3)), np.broadcast_to([1.0, 0, 0, 0], (*lead, 4)),
        np.full((*lead, 3), 0.01), np.linspace(0.1, 0.9, views * height * WIDTH).reshape(lead),
        np.zeros((*lead, 1, 3)), (Camera(K, c2w, WIDTH, height),) * views,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("count", "views"),
    [
        (2, [0, 1]), (6, [0, 1, 2, 3, 4, 5]), (7, [0, 1, 2, 3, 4, 5, 6]), (9, [0, 1, 2, 3, 5, 6, 7, 8]),
        (71, [0, 10, 20, 30, 40, 50, 60, 70]),
    ],
)  # fmt: skip
def test_eight_photos_spread_over_a_capture_are_looked_at(count: int, views: list[int]) -> None:
    assert own.looked_at(count) == views


@pytest.mark.parametrize(
    ("first", "height", "rows"),
    [
        (60, 40, (48, 128)),  # rows 64, 80 and 96 lie within a quarter of the band about it; one more on either side
        (0, 20, (0, 48)),
        (140, 20, (128, 160)),
        (80, 2, (64, 112)),
        (72, 2, (0, 160)),  # between two rows that are looked at, and none near: all
    ],
)
def test_a_band_is_drawn_with_the_rows_about_it(first: int, height: int, rows: tuple[int, int]) -> None:
    gaussians = wall(2)
    band = own._rows_of(gaussians.cameras[0], slice(first, first + height))
    assert (band.height, band.width) == (height, WIDTH)
    assert_array_equal(band.K - gaussians.cameras[0].K, [[0, 0, 0], [0, 0, -first], [0, 0, 0]])
    for given in (gaussians, replace(gaussians, means=gaussians.means - [1, 2, 3], origin=[1.0, 2, 3])):
        part = own._about(given, band)
        assert part.opacities.shape == (2, rows[1] - rows[0], WIDTH)
        for name in FIELDS:
            assert_array_equal(getattr(part, name), getattr(given, name)[:, rows[0] : rows[1]])
        assert [camera.height for camera in part.cameras] == [rows[1] - rows[0]] * 2
        assert [camera.K[1, 2] for camera in part.cameras] == [HEIGHT / 2 - rows[0]] * 2


def test_what_lies_behind_the_camera_is_not_about_a_band() -> None:
    gaussians = wall()
    means = gaussians.means.copy()
    means[:, 32:] = 2 * gaussians.cameras[0].centre - means[:, 32:]
    part = own._about(replace(gaussians, means=means), own._rows_of(gaussians.cameras[0], slice(0, 40)))
    assert part.opacities.shape[1] == 48


class Black:
    """A renderer that draws nothing, and remembers what it was asked for."""

    asked: list[tuple[tuple[int, ...], Camera]]

    def __init__(self, gaussians: Gaussians, threads: int | None, compiled: bool) -> None:
        assert threads == 3 and not compiled
        self.shape = gaussians.opacities.shape

    def render(self, camera: Camera) -> NDArray:
        self.asked.append((self.shape, camera))
        return np.zeros((camera.height, camera.width, 3))


@pytest.mark.parametrize(
    ("height", "pixels", "first", "rows"),
    [
        (HEIGHT, 40 * WIDTH, 60, 40), (HEIGHT, 41 * WIDTH - 1, 60, 40), (HEIGHT, 41 * WIDTH, 59, 41),
        (HEIGHT, HEIGHT * WIDTH, 0, HEIGHT), (HEIGHT, 10**9, 0, HEIGHT), (HEIGHT, WIDTH - 1, 79, 1), (81, WIDTH, 40, 1),
    ],
)  # fmt: skip
def test_a_band_across_the_middle_is_compared(monkeypatch, height: int, pixels: int, first: int, rows: int) -> None:
    monkeypatch.setattr(own, "OWN_PIXELS", pixels)
    monkeypatch.setattr(own, "Renderer", Black)
    monkeypatch.setattr(Black, "asked", [], raising=False)
    gaussians = wall(3, height)
    pictures = np.broadcast_to(np.linspace(0, 1, height)[:, None, None], (2, height, WIDTH, 3)).copy()
    pictures[1] *= 0.5
    levels = [-10 * math.log10(np.mean(np.linspace(0, by, height)[first : first + rows] ** 2)) for by in (1, 0.5)]
    assert own.own_psnr(gaussians, pictures, 3, [2, 0]) == pytest.approx(np.mean(levels))
    assert own.own_psnr(gaussians, pictures, 3) == pytest.approx(np.mean(levels))
    assert len(Black.asked) == 4
    for shape, camera in Black.asked:
        assert (camera.height, camera.K[1, 2]) == (rows, height / 2 - first)
        assert (shape == (3, height, WIDTH)) or rows < height


def test_a_photo_is_compared_up_to_a_megapixel_and_pictures_below_20_db_are_called_low() -> None:
    assert own.OWN_PIXELS == 1024 * 1024 and own.LOW_DB == 20
