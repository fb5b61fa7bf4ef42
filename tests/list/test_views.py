"""Views about scenes: all of an object, and a room from within."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_list

pytest.importorskip("numba")

from tinysplat_runtime.list.views import views_about


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


def test_rooms_are_seen_from_within_too():
    rng = np.random.default_rng(1)
    walls = make_list(4000, 0, rng)
    room = replace(walls, means=_on_a_box(4000, 3.0, rng), scales=np.full((4000, 3), 0.2), opacities=np.full(4000, 0.9))
    inside = [c for c in views_about(room, 18) if np.linalg.norm(c.centre) < 1]
    assert inside
    sparse = replace(room, opacities=np.full(4000, 0.01))
    assert not [c for c in views_about(sparse, 18) if np.linalg.norm(c.centre) < 1]
