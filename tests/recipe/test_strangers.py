"""Photos that the others contradict are found, however they are exposed, and photos that look elsewhere are kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import make_cameras

pytest.importorskip("numba")

import tinysplat_runtime as ts
from tinysplat_runtime.recipe.strangers import likeness, strangers
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.scenes import Frame, Scene

VIEWS, HEIGHT, WIDTH = 9, 40, 48


def predicted(photos: np.ndarray, cameras: list[ts.Camera]) -> ts.Gaussians:
    """What a network makes of photos (V, H, W, 3) of a wall at a depth of 3: each on its own pixels."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cameras[0].K).T
    means = np.stack([camera.centre + 3 * rays @ camera.rotation.T for camera in cameras])
    lead = means.shape[:3]
    quats, scales = np.broadcast_to([1.0, 0, 0, 0], (*lead, 4)), np.full((*lead, 3), 0.04)
    sh = ((photos - 0.5) / 0.2820948)[..., None, :]
    return ts.Gaussians(means, quats, scales, np.full(lead, 0.8), sh, tuple(cameras))


@pytest.fixture(scope="module")
def wall() -> tuple[np.ndarray, list[ts.Camera]]:
    """Photos of a painted wall, taken next to each other."""
    cameras = make_cameras(VIEWS, HEIGHT, WIDTH, turn=0, shift=(0, 0))
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cameras[0].K).T
    places = np.stack([camera.centre + 3 * rays for camera in cameras])
    waves = np.stack([np.sin(6 * places[..., 0]), np.cos(7 * places[..., 1]), np.sin(8 * places.sum(-1))], axis=-1)
    return 0.5 + 0.35 * waves, cameras


def found(
    photos: np.ndarray, cameras: list[ts.Camera], folder: Path, shown: np.ndarray | None = None
) -> tuple[int, ...]:
    """Of photos, whose Gaussians show others where these are given."""
    frames = []
    for view, (photo, camera) in enumerate(zip(photos, cameras, strict=True)):
        write_png(folder / f"{view}.png", photo)
        frames.append(Frame(camera, folder / f"{view}.png"))
    gaussians = predicted(photos if shown is None else shown, cameras)
    return strangers(gaussians, Scene(folder, tuple(frames), 1.0, 9.0), 1)


@pytest.mark.parametrize("strange", [{4}, {0}, {3, 4}, {2, 6}])
def test_strangers_are_found(wall: tuple[np.ndarray, list[ts.Camera]], strange: set[int], tmp_path: Path) -> None:
    photos, cameras = wall[0].copy(), wall[1]
    other = (
        np.random.default_rng(0).uniform(size=(VIEWS, HEIGHT // 4, WIDTH // 4, 3)).repeat(4, axis=1).repeat(4, axis=2)
    )
    for view in strange:
        photos[view] = other[view]
    assert set(found(photos, cameras, tmp_path)) == strange


def test_where_nothing_agrees_nobody_is_a_stranger(wall: tuple[np.ndarray, list[ts.Camera]], tmp_path: Path) -> None:
    assert found(np.random.default_rng(0).uniform(size=wall[0].shape), wall[1], tmp_path) == ()


@pytest.mark.parametrize("count", [3, 4])
def test_of_a_few_photos_that_their_gaussians_do_not_show_none_is_the_stranger(
    wall: tuple[np.ndarray, list[ts.Camera]], count: int, tmp_path: Path
) -> None:
    blocks = np.random.default_rng(1).uniform(size=(2, count, HEIGHT // 4, WIDTH // 4, 3))
    photos, others = blocks.repeat(4, axis=2).repeat(4, axis=3)
    assert found(photos, wall[1][:count], tmp_path, others) == ()


def test_of_two_photos_none_is_the_stranger(wall: tuple[np.ndarray, list[ts.Camera]], tmp_path: Path) -> None:
    photos = np.random.default_rng(0).uniform(size=(2, *wall[0].shape[1:]))
    assert found(photos, wall[1][3:5], tmp_path) == ()


def blurred(photo: np.ndarray) -> np.ndarray:
    return (photo + sum(np.roll(photo, by, axis) for by in (-2, -1, 1, 2) for axis in (0, 1))) / 9


@pytest.mark.parametrize("change", [lambda photo: photo, lambda photo: photo / 4, blurred, lambda _: np.float64(0.5)])
def test_what_belongs_is_kept(wall: tuple[np.ndarray, list[ts.Camera]], change, tmp_path: Path) -> None:
    photos = wall[0].copy()
    photos[4] = change(photos[4])
    assert found(photos, wall[1], tmp_path) == ((4,) if np.ptp(photos[4]) == 0 else ())


def test_who_looks_where_no_other_does_is_kept(wall: tuple[np.ndarray, list[ts.Camera]], tmp_path: Path) -> None:
    photos, cameras = wall[0].copy(), list(wall[1])
    away = np.array(cameras[8].c2w)
    away[0, 3] += 4
    cameras[8] = replace(cameras[8], c2w=away)
    photos[8] = np.random.default_rng(0).uniform(size=(HEIGHT // 4, WIDTH // 4, 3)).repeat(4, axis=0).repeat(4, axis=1)
    assert found(photos, cameras, tmp_path) == ()


def test_likeness_depends_on_neither_exposure_nor_noise_where_nothing_is() -> None:
    rng = np.random.default_rng(0)
    picture, known = rng.uniform(size=(24, 32, 3)), np.ones((24, 32), bool)
    assert likeness(picture, 0.2 + 0.3 * picture, known) > 0.99
    assert abs(likeness(picture, rng.uniform(size=(24, 32, 3)), known)) < 0.2
    assert likeness(picture, np.zeros_like(picture), known) < 0.1
    even = [0.5 + 0.001 * rng.standard_normal(picture.shape) for _ in range(2)]
    assert likeness(*even, known) > 0.9
