"""Where a page begins: at the view that shows most of what all do, or, of a list, at the side that shows most of it.

front.js says the same, for files that a player opens.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..gaussian.sh import C0
from ..scene.cameras import Camera, intrinsics, posed
from ..scene.frusta import points_seen, sees
from ..scene.look import range_guessed

SIDES = 16
"""Directions, level about the vertical axis, that an object is looked at from."""

CELLS = 48
"""Cells along a side of the picture in which points stand for what shows."""

DETAIL = 4.0
"""What the contrast between two cells counts beside a cell that is covered: fronts have more of it than backs."""

SIZE, FILLED = 640, 0.9
"""Pixels of the picture's sides, and how much of it the bulk takes."""

BULK, SAMPLED = (0.03, 0.97), 20000
"""Shares of the points that bound the bulk on each axis, and how many points are looked at."""

OPAQUE = 0.1
"""Opacity from which a Gaussian counts."""

_LUMA = np.array([0.3, 0.59, 0.11])

NEARLY = 0.95
"""Share of the most that is shown from which on a view shows nearly as much."""


def front_view(cameras: Sequence[Camera]) -> int:
    """Index of the camera in the middle of those that have nearly most of what all have in their frames; 0 of none.

    About an object all show as much, and what the first and the last show, few others have seen.
    """
    if len(cameras) < 2:
        return 0
    near, far = range_guessed(cameras)
    points = np.concatenate([points_seen(camera, near, far) for camera in cameras])
    seen = np.array([sees(camera, points, near, far).sum() for camera in cameras])
    centres = np.stack([camera.centre for camera in cameras])
    away = np.linalg.norm(centres[:, None] - centres, axis=-1).mean(axis=1)
    return int(np.argmin(np.where(seen >= NEARLY * seen.max(), np.round(away / max(away.max(), 1e-30), 9), np.inf)))


def front_of(gaussians: Gaussians) -> Camera:
    """Where a list (N,) is first looked at from: the front one of its viewpoints, or, where none are known, the side
    that shows most: where it covers most and has most contrast, never from its edge.
    """
    if gaussians.viewpoints:
        return gaussians.viewpoints[front_view(gaussians.viewpoints)]
    step = max(math.ceil(gaussians.count / SAMPLED), 1)
    solid = gaussians.opacities[::step] > OPAQUE
    points = gaussians.means[::step][solid].astype(np.float64)
    lumas = 0.5 + C0 * gaussians.sh[::step, 0][solid].astype(np.float64) @ _LUMA
    if not len(points):
        points, lumas = np.zeros((1, 3)), np.zeros(1)
    ordered = np.sort(points, axis=0)
    low, high = (ordered[math.floor(share * (len(points) - 1))] for share in BULK)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 or 1.0
    turns = [_turned(2 * math.pi * n / SIDES) for n in range(SIDES)]
    rotation = max(turns, key=lambda turn: _shown((points - middle) / radius, lumas, turn))
    corners = (
        np.stack(np.meshgrid(*np.stack([low, high], axis=1) - middle[:, None]), axis=-1).reshape(-1, 3) @ rotation.T
    )
    away = float((2 * np.abs(corners[:, :2]).max(axis=1) / FILLED - corners[:, 2]).max()) or 1.0
    c2w = posed(rotation.T, gaussians.origin + middle - away * rotation[2])
    return Camera(intrinsics(SIZE, SIZE, SIZE / 2, SIZE / 2), c2w, SIZE, SIZE)


def _turned(angle: float) -> NDArray:
    """Rows right, down and forward of a camera that looks level."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])


def _shown(points: NDArray, lumas: NDArray, rotation: NDArray) -> float:
    """How much points (P, 3), in radii about their middle, show from far in front: cells that are covered, and the
    contrast between the nearest points of neighbouring ones.
    """
    local = points @ rotation.T
    cells = np.floor((local[:, :2] + 1) / 2 * CELLS).astype(int)
    inside = np.flatnonzero(((cells >= 0) & (cells < CELLS)).all(axis=1))
    nearest_last = inside[np.argsort(-local[inside, 2], kind="stable")]
    shown = np.full((CELLS, CELLS), np.nan)
    shown[cells[nearest_last, 1], cells[nearest_last, 0]] = lumas[nearest_last]
    contrast = sum(float(np.nansum(np.abs(np.diff(shown, axis=axis)))) for axis in (0, 1))
    return float(np.isfinite(shown).sum()) + DETAIL * contrast / 2
