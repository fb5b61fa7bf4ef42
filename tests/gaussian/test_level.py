"""Scenes that lie anyhow are turned upright, however they were photographed, and left where up is not sure."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import Heard, make_smooth_gaussians, tells

from tinysplat_runtime.gaussian.editing import moved_camera
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.level import level_of, levelled
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.render.paths import looking_along
from tinysplat_runtime.scene.cameras import Camera, intrinsics, posed

FLOOR, CEILING, WALL, SIDE = (0, 1.5, 0), (0, -1.5, 0), (0, 0, 3), (3, 0, 0)  # planes, by a point as their normal


def surface(*planes: Sequence[float], spread: float = 3.0, noise: float = 0.01) -> NDArray:
    """(N, 3) points on planes through the given points and across them, and in a heap of things on the floor."""
    rng = np.random.default_rng(0)
    parts = [rng.normal((0, 1, 0), (0.4, 0.3, 0.4), (300, 3))]
    for at in planes:
        axis = int(np.argmax(np.abs(at)))
        points = rng.uniform(-spread, spread, (1500, 3))
        points[:, axis] = at[axis] + rng.normal(0, noise, 1500)
        parts.append(points)
    return np.concatenate(parts)


def cameras(directions: NDArray, places: NDArray, roll: float = 0.0) -> list[Camera]:
    """Level cameras that look along directions, each turned about its axis by `roll` and a little more, degrees."""
    rng, taken = np.random.default_rng(1), []
    for direction, place in zip(np.broadcast_to(directions, places.shape), places, strict=True):
        angle = np.radians(roll + rng.normal(0, 2))
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        c2w = posed(looking_along(direction, np.array([0.0, 1, 1e-3])) @ turn, place)
        taken.append(Camera(intrinsics(100, 100, 64, 48), c2w, 128, 96))
    return taken


ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
RING = np.stack([np.sin(ANGLES), 0 * ANGLES, -np.cos(ANGLES)], axis=1)
LINE = np.stack([np.linspace(-1, 1, 12), np.zeros(12), np.zeros(12)], axis=1)
NONE = np.zeros((0, 3))
_START = np.repeat(np.random.default_rng(2).uniform((-2, -1, 4), (2, 1, 5), (60, 3)), 50, axis=0)
STREAKS = _START * np.tile(np.linspace(1, 1.5, 50), 60)[:, None] + np.random.default_rng(3).normal(0, 0.005, (3000, 3))

SURE: dict[str, Callable[[], tuple[list[Camera], NDArray]]] = {
    "a turntable": lambda: (cameras(-RING + (0, 0.6, 0), 3 * RING), surface(spread=0.5)),
    "a table from all sides, the phone askew": lambda: (cameras(-RING + (0, 1, 0), 3 * RING, 25), surface(FLOOR)),
    "a room from inside": lambda: (cameras(RING, 0.2 * RING), surface(FLOOR, WALL, SIDE)),
    "a wall": lambda: (cameras(RING[:3] * (1, 1, -1) + (0, 0, 1), LINE[:3] * 3), surface(WALL)),
    "a ceiling": lambda: (cameras(RING - (0, 1.5, 0), 0.3 * RING), surface(CEILING)),
    "land from a drone that turns": lambda: (cameras(0.05 * RING + (0, 1, 0), 3 * RING - (0, 5, 0)), surface(FLOOR)),
    "land from a drone in a line": lambda: (cameras(np.array([0, 1.5, 1]), LINE - (0, 5, 5)), surface(FLOOR)),
}
UNSURE: dict[str, Callable[[], tuple[list[Camera], NDArray]]] = {
    "two photos": lambda: (cameras(np.array([0, 0.5, 1]), LINE[:2]), NONE),
    "cameras in a line, all looking down": lambda: (cameras(np.array([0, 1, 1]), LINE), surface(spread=0.5)),
    "streaks along the view": lambda: (cameras(np.array([0, -0.2, 1]), 0.3 * LINE), STREAKS),
    "a floor or a wall": lambda: (cameras(np.array([0, 1, 0.02]), LINE - (0, 5, 0)), surface(FLOOR)),
    "nothing": lambda: ([], NONE),
}


def turned(found: tuple[list[Camera], NDArray]) -> tuple[list[Camera], NDArray, NDArray]:
    """Cameras and points that lie anyhow, and where up is."""
    R, t = quats_to_matrices(normalize_quats(np.array([0.5, 0.8, -0.4, 0.3]))), np.array([7.0, -4, 11])
    views, points = found
    return [moved_camera(camera, R, 1, t) for camera in views], points @ R.T + t, -R[:, 1]


@pytest.mark.parametrize("kind", SURE)
def test_up_is_found_however_a_scene_was_photographed(kind: str) -> None:
    views, points, up = turned(SURE[kind]())
    level = level_of(views, points)
    error = np.degrees(np.arccos(np.clip(-(level.rotation @ up)[1], -1, 1)))
    assert level.is_sure and error < 3, f"{level}, off by {error:.1f}°"


@pytest.mark.parametrize("kind", UNSURE)
def test_what_nothing_fixes_is_not_sure(kind: str) -> None:
    assert not level_of(*turned(UNSURE[kind]())[:2]).is_sure


def test_gravity_that_photos_state_tells_up_where_nothing_else_does() -> None:
    views, points, up = turned(UNSURE["cameras in a line, all looking down"]())
    falls = np.random.default_rng(4).normal(-up, 0.02, (7, 3))
    falls[0] = np.roll(falls[0], 1)  # one that somebody has turned
    falls /= np.linalg.norm(falls, axis=1, keepdims=True)
    level = level_of(views, points, falls=falls)
    assert level.is_sure and (level.rotation @ up)[1] < -np.cos(np.radians(2)) and tells(level.evidence, "7 gravity")
    assert not level_of(views, points, falls=falls[:5]).is_sure  # of 12 photos
    assert not level_of(views, points, falls=np.roll(np.eye(3), 1, axis=0).repeat(3, axis=0)).is_sure  # at odds


def test_the_ground_is_at_0_and_the_middle_above_it() -> None:
    views, points, _ = turned(SURE["a table from all sides, the phone askew"]())
    level = level_of(views, points)
    moved = points @ level.rotation.T + level.translation
    np.testing.assert_allclose(np.median(moved[300:], axis=0), 0, atol=0.15)
    assert np.median(moved[:300, 1]) < -0.3  # what stands on it


def test_gaussians_are_turned_with_their_cameras_or_left_and_that_is_said() -> None:
    views, points, _ = turned(SURE["a room from inside"]())
    ones = np.ones(len(points))
    fields = {
        "means": points,
        "quats": np.tile([1.0, 0, 0, 0], (len(points), 1)),
        "scales": np.full((len(points), 3), 0.1),
    }
    scene = Gaussians(**fields, opacities=ones, sh=np.zeros((len(points), 1, 3)), viewpoints=tuple(views))
    told = Heard()
    moved = levelled(scene, told)
    tops = np.stack([-camera.c2w[:3, 1] for camera in moved.viewpoints]).mean(axis=0)
    np.testing.assert_allclose(tops / np.linalg.norm(tops), (0, -1, 0), atol=0.1)
    alone = replace(make_smooth_gaussians(2).flat(), viewpoints=())
    assert levelled(alone, told) is alone
    assert told.kinds == ["notice", "doubt"] and tells(told.lines[0], "24") and tells(told.lines[1], "sure")
