"""How far apart photos of a scene are, in degrees: the angle between the rays from both to what both show.

Neighbours are the pairs of a minimum spanning tree over places and directions (`neighbours.view_places`): the shortest
way from any photo to any other, so that a gap between two parts of a capture is one of its pairs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..system.printable import enumerated
from .cameras import Camera
from .frusta import points_seen, sees
from .neighbours import COMMON, view_places

GOOD_ANGLES = (3.0, 10.0)
"""Degrees between two rays to a point: baselines of 5 % to 17 % of the depth, where photos still look alike."""

MAX_ANGLE = 35.0
"""Degrees at which a pair is worth nothing, and a photo stands alone."""


@dataclass(frozen=True)
class Spacing:
    """How far apart neighbouring photos are.

    Attributes:
        typical: degrees, the median over all neighbours that show something in common; NaN where none do.
        largest: degrees, of the two that are farthest apart; NaN where none are.
        farthest: which two these are.
        alone: photos farther than `MAX_ANGLE` from any other, or with nothing in common with it.
    """

    typical: float
    largest: float
    farthest: tuple[int, int]
    alone: tuple[int, ...]

    @classmethod
    def of(cls, cameras: Sequence[Camera], near: float, far: float) -> Spacing:
        """Measure it, for two cameras or more and the depths between which their scene lies."""
        pairs = _tree(view_places(cameras, near, far))
        angles = [angle_between(cameras[v], cameras[u], near, far) for v, u in pairs]
        least = dict.fromkeys(range(len(cameras)), math.inf)
        for pair, angle in zip(pairs, angles, strict=True):
            for v in pair:
                least[v] = min(least[v], angle)
        known = [(angle, pair) for angle, pair in zip(angles, pairs, strict=True) if math.isfinite(angle)]
        alone = tuple(v for v, angle in least.items() if angle > MAX_ANGLE)
        if not known:
            return cls(math.nan, math.nan, pairs[0], alone)
        return cls(float(np.median([angle for angle, _ in known])), *max(known), alone)

    @property
    def is_good(self) -> bool:
        """Whether all neighbours lie within `GOOD_ANGLES` of each other, on the whole."""
        return GOOD_ANGLES[0] <= self.typical and self.largest <= GOOD_ANGLES[1] and not self.alone

    def said(self, names: Sequence[str]) -> str:
        """The spacing in words, with the photos' names."""
        if math.isnan(self.typical):
            return "no two photos show the same from different places"
        one, other = (names[v] for v in self.farthest)
        gap = f"neighbours are {_degrees(self.typical)} apart, {_degrees(self.largest)} at most ({one} and {other})"
        if len(names) == 2:
            gap = f"{one} and {other} are {_degrees(self.typical)} apart"
        good = f"{GOOD_ANGLES[0]:.0f}° to {GOOD_ANGLES[1]:.0f}° is good"
        if not self.alone or len(names) == 2:
            return f"{gap}; {good}"
        alone = enumerated([names[v] for v in self.alone])
        return f"{gap}; {good}; more than {MAX_ANGLE:.0f}° from any other: {alone}"


def angle_between(camera: Camera, other: Camera, near: float, far: float) -> float:
    """Degrees between the rays of two photos to what both show, the median; infinite where that is next to nothing."""
    points = np.concatenate([points_seen(camera, near, far), points_seen(other, near, far)])
    both = points[sees(camera, points, near, far) & sees(other, points, near, far)]
    if len(both) < COMMON * len(points):
        return math.inf
    rays = [both - one.centre for one in (camera, other)]
    cosines = (rays[0] * rays[1]).sum(axis=1) / np.prod([np.linalg.norm(ray, axis=1) for ray in rays], axis=0)
    return float(np.degrees(np.median(np.arccos(np.clip(cosines, -1, 1)))))


def _degrees(angle: float) -> str:
    return f"{angle:.0f}°" if angle >= GOOD_ANGLES[0] else f"{angle:.1f}°"


def _tree(places: NDArray) -> list[tuple[int, int]]:
    """Pairs, the lower first, of a minimum spanning tree over places (V, D) (Prim 1957)."""
    away = np.linalg.norm(places - places[0], axis=1)
    nearest = np.zeros(len(places), np.int64)
    is_out = np.ones(len(places), bool)
    is_out[0] = False
    pairs = []
    for _ in range(len(places) - 1):
        v = int(np.where(is_out, away, np.inf).argmin())
        is_out[v] = False
        pairs.append((min(v, int(nearest[v])), max(v, int(nearest[v]))))
        distance = np.linalg.norm(places - places[v], axis=1)
        nearest[distance < away] = v
        away = np.minimum(away, distance)
    return pairs
