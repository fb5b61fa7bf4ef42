"""What thumbnails tell of cameras and depths, on two walls at known depths and with cameras given wrongly."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import tinysplat_runtime as ts
from tinysplat_runtime.cli.selfcheck import likely_fault, own_psnr
from tinysplat_runtime.scene.look import range_guessed, range_seen
from tinysplat_runtime.scene.scenes import Frame, Scene

DEPTHS = (2.0, 5.0)
H, W, F = 48, 64, 54.0


def camera(x: float, turn: float = 0.0) -> ts.Camera:
    c2w = np.eye(4)
    c2w[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    c2w[:3, 3] = x, 0.05, 1.0
    return ts.Camera(np.array([[F, 0, W / 2], [0, F, H / 2], [0, 0, 1]]), c2w, W, H)


def texture(x: NDArray, y: NDArray) -> NDArray:
    """Colours of a wall, smooth over a tenth of a unit."""
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(3, 24, 2)) * 7
    phases = rng.uniform(0, 6, (3, 24))
    channels = [
        0.5 + 0.1 * np.sin(x[..., None] * w[:, 0] + y[..., None] * w[:, 1] + p).sum(-1)
        for w, p in zip(waves, phases, strict=True)
    ]
    return np.stack(channels, axis=-1).clip(0, 1)


def photo(view: ts.Camera) -> NDArray:
    """Two walls: one at z = 1 + DEPTHS[0] left of x = 0, one at 1 + DEPTHS[1] behind it."""
    v, u = np.mgrid[0:H, 0:W] + 0.5
    rays = np.stack([(u - W / 2) / F, (v - H / 2) / F, np.ones_like(u)], -1) @ view.c2w[:3, :3].T
    places = [view.centre + rays * ((1 + z - view.centre[2]) / rays[..., 2])[..., None] for z in DEPTHS]
    near, far = (texture(place[..., 0], place[..., 1] + 9 * k) for k, place in enumerate(places))
    return np.where((places[0][..., 0] < 0)[..., None], near, far)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    frames = []
    for i, view in enumerate((camera(-0.15, 0.05), camera(0.15, -0.05))):
        path = tmp_path / f"{i}.png"
        Image.fromarray((photo(view) * 255).astype(np.uint8)).save(path)
        frames.append(Frame(view, path))
    return Scene(tmp_path, tuple(frames), 1.5, 6.0)


def changed(scene: Scene, change) -> Scene:
    def moved(i: int, frame: Frame) -> Frame:
        c2w = change(i, frame.camera.c2w.copy())
        return dataclasses.replace(frame, camera=ts.Camera(frame.camera.K, c2w, W, H))

    return dataclasses.replace(scene, frames=tuple(moved(i, frame) for i, frame in enumerate(scene.frames)))


def scaled(factor: float):
    return lambda i, c2w: np.block([[c2w[:3, :3], factor * c2w[:3, 3:]], [c2w[3:]]])


def turned_round(i: int, c2w: NDArray) -> NDArray:
    return c2w @ np.diag([-1.0, 1, -1, 1]) if i else c2w


def test_right_cameras_are_not_suspected(scene: Scene) -> None:
    assert likely_fault(scene) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda i, c2w: np.linalg.inv(c2w), "w2c"),
        (lambda i, c2w: c2w @ np.diag([1.0, -1, -1, 1]), "OpenGL"),
        (scaled(1000), "times 0.001,"),
        (scaled(0.01), "times 100,"),
        (turned_round, "back to back"),
    ],
)
def test_what_is_wrong_with_cameras_is_named(scene: Scene, change, words: str) -> None:
    fault = likely_fault(changed(scene, change))
    assert fault is not None and words in fault


def test_a_photo_of_one_colour_is_named(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def images(self: Scene) -> NDArray:
        found = np.random.default_rng(0).uniform(size=(len(self.frames), *self.frames[0].camera.K.shape, 3))
        found[1] = 0.01
        return found

    monkeypatch.setattr(Scene, "images", images)
    assert likely_fault(scene) == "photos of one colour show nothing to find depth by: 1"


def test_the_depth_range_is_found_from_photos(scene: Scene) -> None:
    near, far = range_seen(scene.images(), scene.cameras)
    assert 0.5 * DEPTHS[0] < near < DEPTHS[0] and DEPTHS[1] < far < 3 * DEPTHS[1]


def test_photos_that_agree_about_nothing_are_told(scene: Scene) -> None:
    noise = np.random.default_rng(0).uniform(size=(2, H, W, 3))
    with pytest.raises(ts.InputError, match="agree about no depth"):
        range_seen(noise, scene.cameras)
    with pytest.raises(ts.InputError, match="one place"):
        range_seen(scene.images(), [scene.cameras[0]] * 2)


def test_cameras_around_a_thing_look_at_it_and_parallel_ones_far_ahead() -> None:
    def at(angle: float) -> ts.Camera:
        c2w = np.eye(4)
        c2w[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        c2w[:3, 3] = -4 * c2w[:3, 2]
        return ts.Camera(np.array([[F, 0, W / 2], [0, F, H / 2], [0, 0, 1]]), c2w, W, H)

    assert range_guessed([at(angle) for angle in (0, 1, 2)]) == pytest.approx((2, 8), rel=1e-6)
    near, far = range_guessed([camera(0), camera(0.2)])
    assert near == pytest.approx(0.3) and far == pytest.approx(6)


def test_own_psnr_is_that_of_the_render_to_photos() -> None:
    from scenes import make_smooth_gaussians

    gaussians = make_smooth_gaussians(2, 24, 32)
    pictures = np.stack([ts.render(gaussians, view) for view in gaussians.cameras])
    assert own_psnr(gaussians, pictures, None) == pytest.approx(120)
    assert own_psnr(gaussians, pictures + 0.1, None) == pytest.approx(20, abs=1e-3)
