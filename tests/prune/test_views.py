"""Views about scenes: all of an object, and a room from within."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_list

pytest.importorskip("numba")

from tinysplat_runtime.codec.list.views import views_about, views_of
from tinysplat_runtime.render.paths import ring


def _on_a_box(count: int, size: float, rng: np.random.Generator) -> np.ndarray:
    points = rng.uniform(-1, 1, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis])
    return size * points


def test_objects_are_seen_from_all_sides():
    cloud = make_list(500, 0, np.random.default_rng(0))
    moved = replace(cloud, origin=np.array([1e4, -2e4, 5.0]))
    low, high = np.percentile(moved.means, (5, 95), axis=0)
    diagonal, middle = np.linalg.norm(high - low), (low + high) / 2 + moved.origin
    cameras = views_about(moved, 20)
    away = np.stack([camera.centre for camera in cameras]) - middle
    distances = np.linalg.norm(away, axis=1) / diagonal
    bulk = np.quantile(np.linalg.norm(moved.means + moved.origin - middle, axis=1), 0.5) / diagonal
    assert len(cameras) == 20 and distances.min() > bulk and distances.max() < 5
    assert np.abs(away.mean(axis=0)).max() < 0.25 * diagonal
    for camera, towards in zip(cameras, away, strict=True):  # each has the middle in its picture
        u, v, z = camera.K @ camera.rotation @ -towards
        assert z > 0 and 0 < u / z < camera.width and 0 < v / z < camera.height


def test_what_lies_far_off_does_not_move_near_views_away():
    cloud = make_list(500, 0, np.random.default_rng(0))
    means = cloud.means.copy()
    means[::4] *= 30
    far = replace(cloud, means=means)
    nearest = [min(np.linalg.norm(camera.centre) for camera in views_about(one, 20)) for one in (cloud, far)]
    assert nearest[1] < 2 * nearest[0]


def test_rooms_are_seen_from_within_too():
    rng = np.random.default_rng(1)
    walls = make_list(4000, 0, rng)
    room = replace(walls, means=_on_a_box(4000, 3.0, rng), scales=np.full((4000, 3), 0.2), opacities=np.full(4000, 0.9))
    inside = [c for c in views_about(room, 18) if np.linalg.norm(c.centre) < 1]
    assert inside
    sparse = replace(room, opacities=np.full(4000, 0.01))
    assert not [c for c in views_about(sparse, 18) if np.linalg.norm(c.centre) < 1]


def test_photos_are_looked_at_small_and_those_between_them_judge():
    cloud = make_list(500, 0, np.random.default_rng(0))
    shapes = [(1800, 3200), (1800, 3200), (3200, 1800)]
    photos = tuple(camera.resized(*shapes[number % 3]) for number, camera in enumerate(ring(cloud, 60)))
    views = views_of(replace(cloud, viewpoints=photos))
    sizes = [(camera.width, camera.height) for camera in (*views.deciding, *views.judging)]
    assert not views.doubt and all(width * height < 1800 * 3200 / 4 and width != height for width, height in sizes)
    assert 2 <= len(views.deciding) <= 48 and 2 <= len(views.judging) <= 48
    own = np.stack([camera.centre for camera in (*photos, *views.deciding)])
    assert all(np.linalg.norm(own - camera.centre, axis=1).min() > 1e-6 for camera in views.judging)
    radius = max(np.linalg.norm(camera.centre) for camera in photos)
    for camera in (*views.deciding, *views.judging):  # about the scene, as the photos are, and towards it
        assert np.linalg.norm(camera.centre) < 1.05 * radius and camera.rotation[2] @ camera.centre < 0
