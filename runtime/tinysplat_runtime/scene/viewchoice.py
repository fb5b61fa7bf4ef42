"""Which photos of many to take: `--views auto`.

A capture needs the photos without which others could not be drawn (`needed_views`): one after another the photo that
lies farthest from all taken so far (`neighbours` has the distance), until none does by more than SPACING. Up to PLENTY
are taken that lie nearer, as each makes pictures better. Blurred ones give way to sharper ones beside them.

A few photos for one scene are chosen by what they see (`choose_views`). Points are spread through what the cameras see,
between near and far. A choice of views is worth, per point, the best that any two of its views seeing the point are
worth to stereo: nothing at the same place, everything where their rays meet at GOOD_ANGLES, falling to nothing at
MAX_ANGLE. Views are added greedily, one or a pair at a time, whichever gains more per view, so that coverage and
baseline are weighed by one number. Each lies within `MAX_GAP` of one that was chosen before, so that no gap is left
between them; views of another place, which nothing joins to those, begin anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .cameras import Camera
from .frusta import points_seen, sees
from .neighbours import COMMON, Neighbours, joined
from .spacing import GOOD_ANGLES, MAX_ANGLE

ALL_VIEWS = range(2, 7)
"""Numbers of photos of which all are used when none are chosen."""

MIN_ANGLE = 0.1
"""Degrees at which a pair is worth nothing, as at `MAX_ANGLE`."""

MAX_GAP = 45.0
"""Degrees that a view may lie from the others that are chosen, where one in between can be had."""

MAX_CANDIDATES = 64
"""More photos than these are thinned evenly in capture order first."""

SPACING = 0.05
"""Photos nearer to one that is taken can be drawn from it: 5 % of the scene's depth, or 2.9 degrees."""

SHARPER = 1.25
"""A photo gives way to one near it that is so many times as sharp."""

PLENTY = 48
"""Photos that a capture has, if there are as many, though fewer would do."""

NEAREST = 0.01
"""Beside one that is taken, so near, a photo adds nothing."""

FEWEST = 4
"""Photos that a capture has at least, however near to each other they lie."""

RIVALS = 3
"""Photos near one that are looked at, whether they are sharper."""


def needed_views(
    cameras: Sequence[Camera],
    near: float,
    far: float,
    count: int | None = None,
    sharpness: Callable[[int], float] | None = None,
) -> list[int]:
    """Indices, in rising order, of the photos that a capture needs, of all that show something in common with others.

    Args:
        cameras: of all photos.
        near, far: depths of the nearest and the farthest surface, scene units.
        count: how many are wanted, 2 or more; None for as many as it takes.
        sharpness: of a photo by its index, in any unit; asked for few of them.

    Raises:
        InputError: no two photos see the same place from different ones.
    """
    neighbours = Neighbours.of(cameras, near, far)
    useful = np.array([v for v, partners in enumerate(neighbours.partners) if partners], np.int64)
    if not useful.size:
        raise InputError("no two photos see the same place from different ones; name some with --views", where="views")
    places = neighbours.places[useful]
    taken = [int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmin())]
    apart = np.linalg.norm(places - places[taken[0]], axis=1)  # of each from the nearest that is taken
    nearest = np.zeros(len(useful), np.int64)  # which one that is
    while len(taken) < min(count or len(useful), len(useful)):
        farthest = int(apart.argmax())
        if not apart[farthest] > 0 or (count is None and apart[farthest] < _least_apart(len(taken))):
            break
        distance = np.linalg.norm(places - places[farthest], axis=1)
        nearest[distance < apart] = len(taken)
        apart = np.minimum(apart, distance)
        taken.append(farthest)
    if sharpness is not None:
        rivals = [_beside(apart, nearest == n) for n in range(len(taken))]
        asked = {v for i, others in zip(taken, rivals, strict=True) if others for v in (i, *others)}
        sharp = {v: sharpness(int(useful[v])) for v in sorted(asked)}  # in order, as a video is read
        for n, others in enumerate(rivals):
            best = max(others, key=sharp.__getitem__, default=taken[n])
            if others and sharp[best] > SHARPER * sharp[taken[n]]:
                taken[n] = best
    return sorted(int(useful[i]) for i in taken)


def _least_apart(taken: int) -> float:
    """How far from all that are taken the next one has to lie, where nobody says how many are wanted."""
    return 0 if taken < FEWEST else NEAREST if taken < PLENTY else SPACING


def _beside(apart: NDArray, is_here: NDArray) -> list[int]:
    """The `RIVALS` of one that is taken: `apart` (V,) from the nearest that is, which for `is_here` is that one."""
    beside = np.flatnonzero(is_here & (apart > 0) & (apart < SPACING))
    return [int(v) for v in beside[np.argsort(apart[beside], kind="stable")[:RIVALS]]]


def sharpness_of(image: NDArray) -> float:
    """How much of a photo's contrast is between neighbouring pixels: falls where it is blurred.

    Args:
        image: (H, W, 3) float in [0, 1].
    """
    grey = image.mean(axis=2, dtype=np.float64)
    fine = np.square(np.diff(grey, axis=0)).mean() + np.square(np.diff(grey, axis=1)).mean()
    return float(fine / max(grey.var(), 1e-6))


def choose_views(cameras: Sequence[Camera], near: float, far: float, count: int) -> list[int]:
    """Indices, in rising order, of `count` views that cover the scene with baselines that stereo can use.

    Args:
        cameras: of all photos.
        near, far: depths of the nearest and the farthest surface, scene units.
        count: how many are wanted, 2 or more.

    Raises:
        InputError: there are fewer views, or no two of them see the same place from different ones.
    """
    if not 2 <= count <= len(cameras):
        raise InputError(f"{count} of {len(cameras)} photos, expected 2 to {len(cameras)}", where="views")
    spread = np.linspace(0, len(cameras) - 1, min(len(cameras), max(MAX_CANDIDATES, count)))
    candidates = [int(i) for i in np.rint(spread)]
    values, joins = _pair_values([cameras[i] for i in candidates], near, far)  # (C, C, P), (C, C)
    if not values.any():
        raise InputError("no two photos see the same place from different ones; name some with --views", where="views")
    place = np.empty(len(joins), np.int64)  # the number of what each view shows
    for number, views in enumerate(joined([np.flatnonzero(beside).tolist() for beside in joins])):
        place[views] = number
    chosen: list[int] = []
    reached = np.zeros(values.shape[2], np.float32)  # (P,)
    while len(chosen) < count:
        new = ~np.isin(place, place[chosen]) | joins[chosen].any(axis=0)
        new[chosen] = False
        if not new.any():  # all that is left stands apart
            new[:] = True
            new[chosen] = False
        added = _best_addition(values, joins, reached, chosen, new, room=count - len(chosen))
        chosen += added
        reached = np.maximum(reached, values[np.ix_(chosen, added)].max(axis=(0, 1)))
    return sorted(candidates[i] for i in chosen)


def _best_addition(
    values: NDArray, joins: NDArray, reached: NDArray, chosen: list[int], new: NDArray, room: int
) -> list[int]:
    """Of new views (C,) bool, the one that gains most per view, or one and another that goes with it."""
    best, gain = [int(np.argmax(new))], -1.0
    if chosen:
        gains = np.where(new, np.maximum(values[chosen].max(axis=0) - reached, 0).sum(axis=1), -1)  # (C,)
        best, gain = [int(np.argmax(gains))], float(gains.max())
    if room >= 2:
        free = np.ones(len(values), bool)
        free[chosen] = False
        pairs = np.maximum(values - reached, 0).sum(axis=2) * (new[:, None] & free & joins)  # (C, C)
        if pairs.max() / 2 > gain:
            best = [int(i) for i in np.unravel_index(np.argmax(pairs), pairs.shape)]
    return best


def _pair_values(cameras: Sequence[Camera], near: float, far: float) -> tuple[NDArray, NDArray]:
    """What each pair is worth at each point, (C, C, P) float32, 0 where one of them does not see it; whether it joins.

    A pair joins (C, C) that shows something in common, most of it within `MAX_GAP`.
    """
    points = np.concatenate([points_seen(camera, near, far) for camera in cameras])  # (P, 3)
    rays = np.stack([points - camera.centre for camera in cameras])  # (C, P, 3)
    rays /= np.maximum(np.linalg.norm(rays, axis=2, keepdims=True), 1e-30)
    seen = np.stack([sees(camera, points, near, far) for camera in cameras])  # (C, P)
    values = np.zeros((len(cameras), len(cameras), len(points)), np.float32)
    joins = np.zeros((len(cameras), len(cameras)), bool)
    low, high = GOOD_ANGLES
    for i, (ray, visible) in enumerate(zip(rays, seen, strict=True)):
        angle = np.degrees(np.arccos(np.clip((rays * ray).sum(axis=2), -1, 1)))  # (C, P)
        rise, fall = (angle - MIN_ANGLE) / (low - MIN_ANGLE), (MAX_ANGLE - angle) / (MAX_ANGLE - high)
        worth = np.minimum(rise, fall).clip(0, 1)
        both = seen & visible
        values[i] = worth * both
        joins[i] = 2 * (both & (angle < MAX_GAP)).sum(axis=1) > np.maximum(both.sum(axis=1), COMMON * visible.sum())
    return values, joins & joins.T
