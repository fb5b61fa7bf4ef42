"""Which way is up in a scene, and the motion that makes it stand upright: up becomes −y, the ground y = 0, and the
middle of what is looked at x = z = 0.

People hold cameras level: the x axes of cameras are horizontal, however far they look up or down. Normals of floors and
tables lie along the vertical, those of walls across it. One fit weighs all of these, each by how well it agrees
(iteratively reweighted least squares; Holland and Welsch 1977). Where most photos say which way things fell and agree,
that is the vertical.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scene.cameras import Camera
from ..scene.look import looked_at
from ..system.blas import product, symmetric_eigen
from ..system.evenly import evenly
from ..system.told import NOBODY, Told
from .editing import similarity
from .gaussians import Gaussians
from .sh import spread_directions

POINTS, NEIGHBOURS = 4000, 24
"""Points that normals are estimated at, and how many of them each normal is estimated from."""

SURE_DEGREES = 5.0
"""Standard deviation of the vertical up to which a scene is turned."""

LEAST_OFF = 0.5
"""Degrees that a vertical may be off that photos state, however many agree."""

_UP = np.array([0.0, -1.0, 0.0])
_DIRECTIONS = 6000  # about 3° apart
_CONE = -0.1  # least cosine between the vertical and `_mean_up`
_FLAT = 0.1  # variance across a patch over that along it, below which it is a surface
_HALF_DEGREES = (8.0, 5.0, 3.0, 3.0, 3.0)  # of an angle whose weight is halved, in each step of the fit
_FLOOR, _WALL = np.cos(np.radians(8)), np.sin(np.radians(8))
_ROLL, _ALIKE = 2.0, 3.0  # least standard deviation of cameras' roll in degrees, and cameras that share a roll
_PATCHES = 40.0  # independent normals among all
_CLEAR, _RIVAL = 0.12, 1.5  # share of all surfaces that is a floor, and over the largest that is tilted by 20° and more
_CHANCE = 0.3  # share of walls that means something; of random normals an eighth are walls
# A wall seen from ahead and a floor seen from above look alike. Which it is, the cameras have to say: surfaces count
# with this cosine at least between the vertical and `_mean_up`, walls where other cues know it within so many degrees.
_LIKELY, _ROUGH = 0.75, 20.0
_OPAQUE = 0.3


@dataclass(frozen=True, eq=False)
class Level:
    """Where up is, and the motion that makes it −y.

    Attributes:
        rotation, translation: (3, 3) and (3,) float64; x becomes R x + t.
        tilt: degrees between up and −y before.
        off: standard deviation of the vertical, degrees.
        evidence: what it was found by, for people.
    """

    rotation: NDArray
    translation: NDArray
    tilt: float
    off: float
    evidence: str

    @property
    def is_sure(self) -> bool:
        """Whether the vertical is known well enough to turn a scene by it."""
        return self.off <= SURE_DEGREES

    def __str__(self) -> str:
        return f"tilted by {self.tilt:.1f}° ± {self.off:.1f}°, from {self.evidence}"


def levelled(gaussians: Gaussians, told: Told = NOBODY) -> Gaussians:
    """The scene upright, with its cameras; as it is where up is not sure. `told` is told what was found."""
    flat = gaussians.changed(extra_layers=()).flat()
    solid = flat.taken(flat.opacities >= min(_OPAQUE, float(flat.opacities.max())))
    widths = np.sort(solid.scales.astype(np.float64), axis=1)
    level = level_of(flat.viewpoints, solid.means + flat.origin, widths[:, 1] * widths[:, 2])
    if not level.is_sure:
        told.say("doubt", f"not turned, as up is not sure: {level}")
        return gaussians
    told.say("notice", f"{level}; now upright")
    return similarity(gaussians, level.rotation, 1, level.translation)


def level_of(
    cameras: Sequence[Camera], points: NDArray, areas: NDArray | None = None, falls: NDArray | None = None
) -> Level:
    """Find the vertical, the ground and the middle of a scene.

    Args:
        cameras: of its photos; without any, surfaces alone tell the vertical, which lies about −y.
        points: (N, 3) float64 on its surfaces, world.
        areas: (N,) of the surface that each stands for; None for equal ones.
        falls: (n, 3) float64 which way things fell as photos were taken, unit vectors, world; None for no photos that
            say so.
    """
    chosen = evenly(len(points), POINTS) if len(points) else []
    points = points[chosen]
    normals, weights = _normals(points, np.ones(len(points)) if areas is None else areas[chosen])
    rights = np.stack([camera.rotation[0] for camera in cameras]) if cameras else np.zeros((0, 3))
    mean_up = _mean_up(cameras)
    up, rival = _guessed(rights, normals, weights, mean_up)
    for degrees in _HALF_DEGREES:
        up = _fitted(up, rights, normals, weights, float(np.sin(np.radians(degrees))))
    up = up if up @ mean_up >= 0 else -up
    stated = None if falls is None or 2 * len(falls) < len(cameras) else _stated(falls)
    if stated is not None:
        up, off, evidence = stated
    else:
        off, evidence = _judged(up, rights, normals, weights if up @ mean_up > _LIKELY else 0 * weights, rival)
    rotation = _turn(up)
    middle = _middle(cameras, points)
    away = np.linalg.norm(points - middle, axis=1)
    near = away <= np.median(away) if len(points) else away > 0  # the land beyond a terrace is not its floor
    shift = -rotation @ middle
    shift[1] = -_ground(points[near] @ rotation[1], ((weights > 0) & (np.abs(normals @ up) > _FLOOR))[near])
    return Level(rotation, shift, float(np.degrees(np.arccos(np.clip(up @ _UP, -1, 1)))), off, evidence)


def _mean_up(cameras: Sequence[Camera]) -> NDArray:
    """The mean of cameras' −y axes, and as people look down more than up, half of that of their −z axes."""
    if not cameras:
        return _UP
    mean: NDArray = -np.mean([camera.rotation[1] + 0.5 * camera.rotation[2] for camera in cameras], axis=0)
    return mean / max(float(np.linalg.norm(mean)), 1e-12)


def _normals(points: NDArray, areas: NDArray) -> tuple[NDArray, NDArray]:
    """Normals (N, 3) and weights (N,) of the surfaces about points: their areas, no larger than nine tenths of them
    are, 0 where there is no surface, 1 together.
    """
    count = min(NEIGHBOURS, len(points))
    normals, weights = np.zeros((len(points), 3)), np.zeros(len(points))
    if count < 4:
        return normals, weights
    squares = (points**2).sum(axis=1)
    for first in range(0, len(points), 500):
        rows = slice(first, first + 500)
        away = squares[rows, None] + squares - 2 * points[rows] @ points.T
        near = points[np.argpartition(away, count - 1, axis=1)[:, :count]]
        near = near - near.mean(axis=1, keepdims=True)
        values, vectors = symmetric_eigen(product(near.transpose(0, 2, 1), near))
        normals[rows] = vectors[..., 0]
        weights[rows] = values[:, 0] < _FLAT * values[:, 1]
    weights *= np.minimum(areas, np.percentile(areas, 90))
    return normals, weights / max(float(weights.sum()), 1e-300)


def _guessed(rights: NDArray, normals: NDArray, weights: NDArray, mean_up: NDArray) -> tuple[NDArray, float]:
    """The direction that fits most cameras and surfaces, and the share of the largest floor of any other."""
    ways = spread_directions(_DIRECTIONS)
    ways = ways[ways @ mean_up > _CONE]
    along = np.abs(ways @ normals.T)
    floors, walls = (along > _FLOOR) @ weights, (along < _WALL) @ weights
    held = (1 / (1 + (ways @ rights.T / _WALL) ** 2)).mean(axis=1) if len(rights) else 0.0
    best = ways[int(np.argmax(held + floors + 0.7 * walls + 0.8 * (ways @ mean_up)))]
    elsewhere = np.abs(ways @ best) < np.cos(np.radians(20))
    return best, float(floors[elsewhere].max(initial=0.0))


def _fitted(up: NDArray, rights: NDArray, normals: NDArray, weights: NDArray, half: float) -> NDArray:
    """The vertical nearest to all directions, each weighed by how near it lies to where it should; `half` is a sine."""
    held = 1 / (1 + (rights @ up / half) ** 2) ** 2 / max(len(rights), 1)
    along = normals @ up
    floor = weights / (1 + (1 - along**2) / half**2) ** 2
    wall = 0.5 * weights / (1 + (along / half) ** 2) ** 2
    total = floor.sum() * np.eye(3) - _scatter(normals, floor) + _scatter(normals, wall) + _scatter(rights, held)
    return symmetric_eigen(total)[1][:, 0]


def _scatter(vectors: NDArray, weights: NDArray | float) -> NDArray:
    return product((vectors * np.reshape(weights, (-1, 1))).T, vectors)


def _judged(up: NDArray, rights: NDArray, normals: NDArray, weights: NDArray, rival: float) -> tuple[float, str]:
    """The standard deviation of a vertical in degrees, and what speaks for it."""
    along = np.abs(normals @ up)
    is_floor, is_wall = along > _FLOOR, along < _WALL
    floors, walls = float(weights[is_floor].sum()), float(weights[is_wall].sum())
    known = 1e6 * up[:, None] * up  # information, 1/degrees²; turns about the vertical do not matter
    if len(rights):
        roll = np.degrees(np.arcsin(np.clip(rights @ up, -1, 1)))
        known += _scatter(rights, 1 / _ALIKE / max(float((roll**2).mean()), _ROLL**2))
    if floors > max(_CLEAR, _RIVAL * rival):
        spread = float(np.median(np.degrees(np.arccos(np.clip(along[is_floor], -1, 1)))))
        known += _PATCHES * floors / max(spread, 1.0) ** 2 * np.eye(3)
    if walls > _CHANCE and _off(known) < _ROUGH:
        spread = float(np.median(np.degrees(np.arcsin(along[is_wall]))))
        known += _PATCHES * (1 - _CHANCE / walls) / max(spread, 1.0) ** 2 * _scatter(normals[is_wall], weights[is_wall])
    found = [f"{len(rights)} cameras"] if len(rights) else []
    found += [f"floors ({floors:.0%} of surfaces)"] if floors > _CLEAR / 2 else []
    found += [f"walls ({walls:.0%})"] if walls > _CHANCE else []
    return _off(known), ", ".join(found) or "nothing"


def _stated(falls: NDArray) -> tuple[NDArray, float, str] | None:
    """The vertical against which things fell, its standard deviation in degrees and what speaks for it; None where
    photos contradict each other, as those do that somebody has turned.
    """
    down = np.median(falls, axis=0)
    down /= max(float(np.linalg.norm(down)), 1e-12)
    away = float(np.degrees(np.median(np.arccos(np.clip(falls @ down, -1, 1)))))
    off = max(away / float(np.sqrt(len(falls))), LEAST_OFF)
    return None if away > SURE_DEGREES else (-down, off, f"gravity as {len(falls)} photos state it")


def _off(known: NDArray) -> float:
    """Degrees, one standard deviation in the direction that is known least; at most 90."""
    return float(min(1 / np.sqrt(max(float(symmetric_eigen(known)[0][0]), 1e-12)), 90.0))


def _turn(up: NDArray) -> NDArray:
    """The rotation (3, 3) by the least angle that makes a direction −y (Rodrigues)."""
    cosine, cross = float(up @ _UP), np.cross(np.cross(up, _UP), np.eye(3)).T
    if cosine < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    rotation: NDArray = np.eye(3) + cross + product(cross, cross) / (1 + cosine)
    return rotation


def _middle(cameras: Sequence[Camera], points: NDArray) -> NDArray:
    """The point that cameras look at, where they do and it lies amid the scene, else the median of its points."""
    at = looked_at(cameras) if cameras else None
    if not len(points):
        return np.zeros(3) if at is None else at
    low, high = np.percentile(points, (10, 90), axis=0)
    return np.median(points, axis=0) if at is None or not ((low <= at) & (at <= high)).all() else at


def _ground(heights: NDArray, floors: NDArray) -> float:
    """y, which is down, of the lowest large floor, or where there is none, of the lowest hundredth of points."""
    if not len(heights):
        return 0.0
    low, high = (float(y) for y in np.percentile(heights, (1, 99)))
    if floors.mean() < _CLEAR / 4 or not high > low:
        return high
    counts, edges = np.histogram(heights[floors], 60, (low, high))
    pairs = counts[:-1] + counts[1:]  # a floor may lie across an edge
    at = int(np.flatnonzero(pairs >= 0.4 * pairs.max())[-1])
    return float(np.median(heights[(heights >= edges[at]) & (heights <= edges[at + 2]) & floors]))
