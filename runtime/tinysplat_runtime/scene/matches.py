"""Corners that two photos have in common, and how well cameras go with them.

Where a corner of one photo lies in another says nothing about depths, but it lies on a line that the cameras state,
and in front of both. Cameras that belong to the photos have most common corners there; others do not, whatever depths
are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cameras import Camera

CORNERS = 600
"""Corners of a photo that are looked at, the clearest."""

PATCH, STEP = 8, 2
"""What is compared about them: so many pixels a side, so far apart."""

LOWES_RATIO = 0.8
"""Distance of a corner's descriptor to the nearest over that to the next one, below which a match is no chance."""

NOISE = 0.7
"""Pixels that a corner lies off where cameras are right, one standard deviation."""

WELL, MOVED = 0.5, 3.0
"""A corner tells its depth that fits at least so well, and lies so many pixels from where it would infinitely far."""

STAYING, UNDISTURBED = 3, 0.75
"""Corners a pair of photos that stay at their place, and their share of the corners there, where something is on the
lens or on the photos. Right photos of 24 captures have none; about the axis of a turntable one stays, of which 0.65."""

TWICE, EYES = 0.15, 0.15
"""Share of corners that the halves of a picture have in common where they are two eyes' views of one place, and of a
half's width that these lie apart at most."""

MARGIN = PATCH * STEP // 2 + 1


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a photo: places (N, 2) in pixels, x first, and their patches as descriptors (N, D) of unit length."""

    places: NDArray
    descriptors: NDArray


def corners(image: NDArray) -> Corners:
    """The clearest corners of a photo (H, W, 3), float in [0, 1], a few pixels apart."""
    grey = _blurred(image.mean(axis=-1, dtype=np.float32), 1)
    down, right = np.gradient(grey)
    xx, yy, xy = (_blurred(product, 2) for product in (right * right, down * down, right * down))
    strength = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)  # the smaller eigenvalue
    strength[:MARGIN] = strength[-MARGIN:] = strength[:, :MARGIN] = strength[:, -MARGIN:] = 0
    peak = strength > 1e-7
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            if dy or dx:
                peak &= strength >= np.roll(strength, (dy, dx), axis=(0, 1))
    row, column = np.nonzero(peak)
    chosen = np.argsort(-strength[row, column], kind="stable")[:CORNERS]
    row, column = row[chosen], column[chosen]
    offset = (np.arange(PATCH) - PATCH // 2) * STEP + STEP // 2
    patches = grey[row[:, None, None] + offset[:, None], column[:, None, None] + offset]
    descriptors = patches.reshape(len(row), PATCH * PATCH)
    descriptors = descriptors - descriptors.mean(axis=1, keepdims=True)
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True).clip(1e-6)
    shifts = [
        _between(strength[row - dy, column - dx], strength[row, column], strength[row + dy, column + dx])
        for dx, dy in ((1, 0), (0, 1))
    ]
    return Corners(np.stack([column + shifts[0], row + shifts[1]], axis=1) + 0.5, descriptors)


def matched(one: Corners, other: Corners) -> NDArray:
    """(M, 6) float64 places x, y, 1 in one photo and in another of corners that look alike, and like no other."""
    if len(one.places) < 2 or len(other.places) < 2:
        return np.empty((0, 6))
    alike = one.descriptors @ other.descriptors.T
    best, back = alike.argmax(axis=1), alike.argmax(axis=0)
    index = np.arange(len(best))
    most = alike[index, best]
    alike[index, best] = -1
    clear = 1 - most < LOWES_RATIO**2 * (1 - alike.max(axis=1))
    kept = (back[best] == index) & clear
    unit = np.ones((int(kept.sum()), 1))
    return np.concatenate([one.places[kept], unit, other.places[best[kept]], unit], axis=1)


def staying(pairs: Sequence[NDArray]) -> NDArray:
    """(N, 2) places, some of them several times, at which corners stay in most pairs while all others move.

    Args:
        pairs: what pairs of photos have in common, (M, 6) float64 of `matched`.

    Returns:
        None where these are so few, or others move so near to them, that it may be chance.
    """
    still: list[NDArray] = []
    moving: list[NDArray] = []
    for matches in pairs:
        moved = np.linalg.norm(matches[:, 3:5] - matches[:, :2], axis=1)
        stays = moved < NOISE
        if not stays.all() and np.median(moved[~stays]) >= MOVED:
            still.append(matches[stays, :2])
            moving.append(matches[~stays, :2])
    if not still:
        return np.empty((0, 2))
    places = np.concatenate(still)
    count = np.sum([_near(places, others, MOVED) for others in still], axis=0)
    kept = places[count > max(1, len(still) / 2)]
    if len(kept) < STAYING * len(still):
        return np.empty((0, 2))
    disturbing = _near(np.concatenate(moving), kept, 2 * MOVED).sum()
    return kept if len(kept) >= UNDISTURBED * (len(kept) + disturbing) else np.empty((0, 2))


def doubled(image: NDArray) -> str:
    """Whether a picture (H, W, 3), float in [0, 1], is two of one place, as 3D films have them, `side by side` or `one
    above the other`; else nothing.
    """
    height, width = (side // 2 for side in image.shape[:2])
    for words, first, second in (
        ("side by side", image[:, :width], image[:, -width:]),
        ("one above the other", image[:height], image[-height:]),
    ):
        one, other = corners(first), corners(second)
        common = matched(one, other)
        down, across = np.abs(common[:, 4] - common[:, 1]), np.abs(common[:, 3] - common[:, 0])
        level = (down < MOVED) & (across < EYES * first.shape[1])
        if level.sum() > TWICE * max(min(len(one.places), len(other.places)), CORNERS / 4):
            return words
    return ""


def place_in_picture(places: NDArray, width: int, height: int) -> str:
    """Where most of places (N, 2) lie in a picture of that size, in words."""
    x, y = np.median(places, axis=0) / (width, height)
    words = (("left", "right", x), ("top", "bottom", y))
    return ", ".join(low if at < 1 / 3 else high if at > 2 / 3 else "middle" for low, high, at in words)


def _near(places: NDArray, others: NDArray, radius: float) -> NDArray:
    """(N,) whether one of (M, 2) is within a radius of each of (N, 2)."""
    return (np.linalg.norm(places[:, None] - others, axis=2) < radius).any(axis=1)


def inliers(places: NDArray, camera: Camera, its: Camera) -> float:
    """How many of places (M, 6) float64 in two photos, of `matched`, lie where cameras allow, each by how close."""
    return float(_fits(places, camera, its)[0].sum())


def depths_told(places: NDArray, camera: Camera, its: Camera) -> NDArray:
    """(N,) depths in a photo's camera, scene units, of those of places (M, 6) float64 that fit and tell it.

    They tell it where another depth would move them by some pixels.
    """
    depths = depths_of(places, camera, its)
    return depths[~np.isnan(depths)]


def depths_of(places: NDArray, camera: Camera, its: Camera) -> NDArray:
    """(M,) depths in a photo's camera, scene units, of places (M, 6) float64; NaN of those that tell none."""
    fits, depth, infinite = _fits(places, camera, its)
    moved = np.linalg.norm(places[:, 3:5] - infinite, axis=1)
    return np.where((fits > WELL) & (moved > MOVED), depth, np.nan)


def _fits(places: NDArray, camera: Camera, its: Camera) -> tuple[NDArray, NDArray, NDArray]:
    """Of each of places (M, 6) how well it fits, 0 to 1, its depth, and (M, 2) where it would lie infinitely far."""
    rotation, other = camera.rotation, its.rotation
    turn, shift = other @ rotation.T, other @ (camera.centre - its.centre)
    unproject, unproject_its = np.linalg.inv(camera.K), np.linalg.inv(its.K)
    across = np.array([[0, -shift[2], shift[1]], [shift[2], 0, -shift[0]], [-shift[1], shift[0], 0]])
    fundamental = unproject_its.T @ across @ turn @ unproject
    here, there = places[:, :3], places[:, 3:]
    line, back = here @ fundamental.T, there @ fundamental
    steepness = line[:, 0] ** 2 + line[:, 1] ** 2 + back[:, 0] ** 2 + back[:, 1] ** 2
    apart = (there * line).sum(axis=1) ** 2 / steepness.clip(1e-24)  # Sampson's distance, squared
    ray, its_ray = here @ (turn @ unproject).T, there @ unproject_its.T  # depth · ray + shift lies along its_ray
    aa, ab, bb = (ray * ray).sum(axis=1), (ray * its_ray).sum(axis=1), (its_ray * its_ray).sum(axis=1)
    a, b = ray @ shift, its_ray @ shift
    ahead = (ab * b > bb * a) & (aa * b > ab * a)
    depth = (ab * b - bb * a) / (aa * bb - ab * ab).clip(1e-24)
    infinite = ray @ its.K.T
    with np.errstate(divide="ignore", invalid="ignore"):
        infinite = infinite[:, :2] / infinite[:, 2:]
    return np.where(ahead, np.exp(-apart / (2 * NOISE**2)), 0.0), depth, infinite


def _between(before: NDArray, peak: NDArray, after: NDArray) -> NDArray:
    """Where the parabola through three neighbouring values is highest, from the middle one."""
    return (after - before) / (2 * (2 * peak - before - after)).clip(1e-12)


def _blurred(values: NDArray, times: int) -> NDArray:
    """Means over 3×3 pixels, weighted 1, 2, 1, so many times."""
    for _ in range(times):
        for axis in (0, 1):
            padded = np.pad(values, [(1, 1) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
            n = values.shape[axis]
            low, mid, high = (padded.take(range(k, k + n), axis) for k in range(3))
            values = (low + 2 * mid + high) / 4
    return values
