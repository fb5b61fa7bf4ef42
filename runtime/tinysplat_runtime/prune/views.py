"""Views that Gaussians of no pixels are looked at from: from all sides, far and near, and from within rooms."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..codec.free.octree import morton_keys
from ..gaussian.gaussians import Gaussians
from ..render import DEFINITION, Renderer
from ..render.paths import looking_along
from ..scene.cameras import Camera

SIDE = 384
"""Pixels of a view's sides."""

FAR, NEAR = 1.2, 2.0
"""Distances of the outer views: far ones from the middle of the bulk, in its diagonals; near ones from the median, in
median distances from it. About a captured place, which thins out towards the distance, the latter are much less."""

NEAR_EVERY = 4
"""One of so many outer views is a near one."""

STEEPEST = 0.7
"""Sine of the largest angle that outer views look up or down by."""

OPEN, CLOSED = 0.2, 0.75
"""A scene is a room where, from its middle, so far (in diagonals) nothing stands in most directions, and something
beyond in this share of them."""

UNEVEN = 3.0
"""Octaves between the sizes of Gaussians in the finest and the coarsest parts of a scene: of a place, at least so many."""

ALIKE = 64
"""Gaussians in a row along a curve through space whose median size is that of a part."""

_GOLDEN = math.pi * (3 - math.sqrt(5))
_BITS = 20
_DOWN = np.array([0.0, 1.0, 0.0])


def is_place(gaussians: Gaussians) -> bool:
    """Whether (N,) Gaussians show what was seen from within, and views from outside would show too little of.

    Gaussians are about as large as pixels of the photos that they were made from. About an object cameras are equally
    far from all of it; in a place they are near some of it and far from the rest, and sizes differ by as much.
    """
    means = gaussians.means.astype(np.float64)
    low, high = np.percentile(means, (1, 99), axis=0)
    unit = (1 << _BITS) / (2 * float((high - low).max()) or 1.0)
    cells = ((means - low) * unit + (1 << (_BITS - 2))).clip(0, (1 << _BITS) - 1)
    order = np.argsort(morton_keys(cells.astype(np.int64)), kind="stable")
    widths = np.sort(gaussians.scales, axis=1)[order, 1:].astype(np.float64)
    sizes = np.log2(np.maximum(widths, 1e-15)).mean(axis=1)
    parts = max(len(sizes) // ALIKE, 1)
    finest, coarsest = np.percentile([np.median(part) for part in np.array_split(sizes, parts)], (5, 95))
    return bool(coarsest - finest >= UNEVEN)


def views_about(gaussians: Gaussians, count: int) -> list[Camera]:
    """Cameras that see (N,) Gaussians as those would who walk about them.

    They stand outside, some of them near, evenly on the sphere but for its poles; of a room, a third of all
    stand in its middle and look outwards.
    """
    means = gaussians.means.astype(np.float64) + gaussians.origin
    low, high = np.percentile(means, (5, 95), axis=0)
    middle, diagonal = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
    centre = np.median(means, axis=0)
    close = NEAR * float(np.median(np.linalg.norm(means - centre, axis=1))) or 1.0
    inner = count // 3 if _is_room(gaussians, middle, diagonal) else 0
    outer = count - inner
    cameras = []
    for number in range(outer):
        towards = _on_the_sphere(number, outer, STEEPEST)
        is_near = number % NEAR_EVERY == 2
        place = centre + close * towards if is_near else middle + FAR * diagonal * towards
        cameras.append(_camera(place, -towards, SIDE, SIDE))
    return cameras + [_camera(middle, _on_the_sphere(n, inner, 0.5), SIDE / 2, SIDE) for n in range(inner)]


def _on_the_sphere(number: int, count: int, steepest: float) -> NDArray:
    """Unit vector of a Fibonacci spiral about the y axis."""
    height = steepest * (1 - (2 * number + 1) / count)
    turn, flat = number * _GOLDEN + 0.1, math.sqrt(1 - height * height)
    return np.array([math.sin(turn) * flat, height, math.cos(turn) * flat])


def _camera(place: NDArray, direction: NDArray, focal: float, side: int) -> Camera:
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = looking_along(direction, down=_DOWN), place
    return Camera(np.array([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1]]), c2w, side, side)


def _is_room(gaussians: Gaussians, middle: NDArray, diagonal: float) -> bool:
    """Whether the middle is empty and walled in."""
    renderer = Renderer(gaussians, 1, **DEFINITION)
    depths, alphas = [], []
    for turn in range(4):
        direction = np.array([math.sin(turn * math.pi / 2), 0.0, math.cos(turn * math.pi / 2)])
        seen = renderer.render(_camera(middle, direction, 16, 32), outputs=("depth", "alpha"))
        depths.append(seen["depth"])
        alphas.append(seen["alpha"])
    alpha, depth = np.concatenate(alphas), np.concatenate(depths)
    return bool(np.median(depth) > OPEN * diagonal and (alpha > 0.5).mean() > CLOSED)
