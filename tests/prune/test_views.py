"""Views about scenes: all of an object, and a room from within."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_free_gaussians

pytest.importorskip("numba")

from tinysplat_runtime.prune import views
from tinysplat_runtime.prune.views import _is_room, _on_the_sphere, views_about


def _on_a_box(count: int, size: float, rng: np.random.Generator) -> np.ndarray:
    points = rng.uniform(-1, 1, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis])
    return size * points


def test_objects_are_seen_from_all_sides():
    cloud = make_free_gaussians(500, 0, np.random.default_rng(0))
    moved = replace(cloud, origin=np.array([1e4, -2e4, 5.0]))
    low, high = np.percentile(moved.means, (5, 95), axis=0)
    diagonal, middle = np.linalg.norm(high - low), (low + high) / 2 + moved.origin
    cameras = views_about(moved, 20)
    away = np.stack([camera.centre for camera in cameras]) - middle
    distances = np.linalg.norm(away, axis=1) / diagonal
    centre = np.median(moved.means, axis=0) + moved.origin
    apart = np.linalg.norm(np.stack([camera.centre for camera in cameras]) - centre, axis=1)
    usual = np.median(np.linalg.norm(moved.means + moved.origin - centre, axis=1))
    is_near = np.isclose(apart, 2.0 * usual, rtol=1e-3)
    assert len(cameras) == 20 and is_near.sum() == 5 and np.allclose(distances[~is_near], 1.2, rtol=1e-3)
    assert np.abs(away.mean(axis=0)).max() < 0.25 * diagonal
    for camera, towards, near in zip(cameras, away, is_near, strict=True):  # each looks at the middle
        towards = camera.centre - centre if near else towards
        assert camera.c2w[:3, 2] @ towards / np.linalg.norm(towards) < -0.999


def test_what_lies_far_off_does_not_move_near_views_away():
    cloud = make_free_gaussians(500, 0, np.random.default_rng(0))
    means = cloud.means.copy()
    means[::4] *= 30
    far = replace(cloud, means=means)
    nearest = [min(np.linalg.norm(camera.centre) for camera in views_about(one, 20)) for one in (cloud, far)]
    assert nearest[1] < 2 * nearest[0]


def test_rooms_are_seen_from_within_too():
    rng = np.random.default_rng(1)
    walls = make_free_gaussians(4000, 0, rng)
    room = replace(walls, means=_on_a_box(4000, 3.0, rng), scales=np.full((4000, 3), 0.2), opacities=np.full(4000, 0.9))
    inside = [c for c in views_about(room, 18) if np.linalg.norm(c.centre) < 1]
    assert len(inside) == 6
    sparse = replace(room, opacities=np.full(4000, 0.01))
    assert not [c for c in views_about(sparse, 18) if np.linalg.norm(c.centre) < 1]


def test_places_on_the_sphere_by_hand() -> None:
    """Evenly in height between sines of the steepest angle, each a golden angle on."""
    golden = np.pi * (3 - np.sqrt(5))
    for count, steepest in ((1, 0.7), (5, 0.7), (4, 0.5)):
        for number in range(count):
            x, y, z = _on_the_sphere(number, count, steepest)
            assert y == pytest.approx(steepest * (1 - (number + 0.5) / (count / 2)))
            assert x * x + y * y + z * z == pytest.approx(1)
            turn = number * golden + 0.1
            np.testing.assert_allclose([x, z], np.sqrt(1 - y * y) * np.array([np.sin(turn), np.cos(turn)]), atol=1e-12)


def test_every_view_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of ten views without a room: the third and the seventh are near. Of a room, a third stand in its middle."""
    cloud = make_free_gaussians(300, 0, np.random.default_rng(2))
    cloud = replace(cloud, means=cloud.means * np.float32([1, 2, 3]), origin=np.array([5.0, 0, -5]))
    means = cloud.means.astype(float) + cloud.origin
    low, high = np.percentile(means, (5, 95), axis=0)
    middle, diagonal, centre = (low + high) / 2, np.linalg.norm(high - low), np.median(means, axis=0)
    close = 2 * np.median(np.linalg.norm(means - centre, axis=1))
    for is_room, inner in ((False, 0), (True, 3)):
        monkeypatch.setattr(views, "_is_room", lambda *_, found=is_room: found)
        cameras = views_about(cloud, 10)
        assert len(cameras) == 10
        for n, camera in enumerate(cameras):
            inside = n >= 10 - inner
            towards = _on_the_sphere(n - 10 + inner, inner, 0.5) if inside else _on_the_sphere(n, 10 - inner, 0.7)
            near = n in (2, 6) and not inside
            place = middle if inside else centre + close * towards if near else middle + 1.2 * diagonal * towards
            np.testing.assert_allclose(camera.centre, place, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(camera.c2w[:3, 2], towards if inside else -towards, atol=1e-9)
            assert camera.c2w[1, 0] == pytest.approx(0, abs=1e-12) and camera.c2w[1, 1] > 0
            focal = 192 if inside else 384
            np.testing.assert_array_equal(camera.K, [[focal, 0, 192], [0, focal, 192], [0, 0, 1]])
            assert (camera.width, camera.height) == (384, 384)
    one = replace(cloud, **{name: getattr(cloud, name)[:1] for name in ("means", "quats", "scales", "opacities", "sh")})
    monkeypatch.setattr(views, "_is_room", lambda *_: False)
    away = [np.linalg.norm(camera.centre - means[0]) for camera in views_about(one, 4)]
    np.testing.assert_allclose(away, [1.2, 1.2, 1.0, 1.2], rtol=1e-6)


@pytest.mark.parametrize(
    ("depth", "covered", "found"),
    [(2.1, 0.76, True), (1.9, 0.76, False), (2.1, 0.74, False), (9.0, 1.0, True), (0.0, 1.0, False)],
)
def test_a_room_is_empty_in_its_middle_and_closed_around(
    monkeypatch, depth: float, covered: float, found: bool
) -> None:
    """Of a diagonal of 10: nothing nearer than 2 in most directions, and something in three quarters of them."""
    asked = []

    class Drawn:
        def __init__(self, *given, **options) -> None:
            assert options == {"dilation": "screen", "order": "depth"}

        def render(self, camera, outputs):
            asked.append(camera)
            alpha = np.where(np.arange(32 * 32) < covered * 32 * 32, 0.51, 0.5).reshape(32, 32)
            return {"depth": np.where(np.arange(32 * 32) < 0.55 * 32 * 32, depth, 0.1).reshape(32, 32), "alpha": alpha}

    monkeypatch.setattr(views, "Renderer", Drawn)
    cloud = make_free_gaussians(3, 0, np.random.default_rng(2))
    assert _is_room(cloud, np.array([1.0, 2, 3]), 10.0) is found
    assert [camera.centre.tolist() for camera in asked] == [[1, 2, 3]] * 4
    np.testing.assert_allclose(
        [c.c2w[:3, 2] for c in asked], [[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-12
    )
    assert all((c.width, c.height, c.K[0, 0], c.K[0, 2], c.K[1, 2]) == (32, 32, 16, 16, 16) for c in asked)
