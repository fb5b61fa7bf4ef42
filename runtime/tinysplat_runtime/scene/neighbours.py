"""Which photos of a capture belong together: neighbours, groups for a network, and the places that a capture shows.

A network finds depth in few photos at a time, and best in those that show the same from near places. How far apart two
photos are counts places and viewing directions alike,

    d² = |c₁ − c₂|² / D² + |a₁ − a₂|²,

c the centres, a the directions (unit vectors), D the scene's depth, the harmonic mean of near and far. Partners of a
photo are the nearest ones that show part of what it does, from another place.

A photo's own group is it and its nearest partners. Those groups are chosen that serve most photos not served yet, where
a group serves those of its photos that it suits about as well as their own would: a third as many groups as photos,
with partners nearly as near.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cameras import Camera
from .frusta import points_seen, sees

GROUP = 4
"""Photos that a network is given at a time: of more, the farther ones make surfaces worse, and all of them slower."""

NEAR = 4
"""Views that a stripe of a capture is drawn from (`codec/depth_step/`)."""

CANDIDATES = 12
"""Nearest photos of each that are looked at."""

COMMON = 0.1
"""Of what a photo shows, the least that a partner must see of it."""

LEAST_BASELINE = 0.002
"""Of the scene's depth: photos from nearer places show no depth together."""

SUITS = 1.3
"""A group suits a photo whose partners in it are at most so many times as far away as those of its own group."""

CLOSE = 0.15
"""Mean distance d to its own partners up to which a photo shares partners with others: in dense captures what a group
finds then agrees. Elsewhere each photo gets its own nearest ones."""

_ROWS = 256  # photos whose distances to all others are held at a time


@dataclass(frozen=True)
class Group:
    """Photos that a network is given together.

    Attributes:
        views: their indices, rising.
        kept: those whose Gaussians are taken from here, rising.
    """

    views: tuple[int, ...]
    kept: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Where photos were taken, and the partners of each.

    Attributes:
        places: (V, 6) float64, centres over D and directions: |p₁ − p₂| is d.
        partners: for each photo those of its `CANDIDATES` that are any, nearest first.
    """

    places: NDArray
    partners: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, cameras: Sequence[Camera], near: float, far: float) -> Neighbours:
        """Find them; memory grows with the number of photos, not with its square.

        Args:
            cameras: one per photo.
            near, far: depths between which the scene lies, scene units.
        """
        places = view_places(cameras, near, far)
        partners: list[tuple[int, ...]] = []
        for v, nearest in enumerate(nearest_places(places, min(CANDIDATES, len(cameras) - 1))):
            points = points_seen(cameras[v], near, far)
            own = [
                int(u)
                for u in nearest
                if np.linalg.norm(places[u, :3] - places[v, :3]) >= LEAST_BASELINE
                and sees(cameras[u], points, near, far).mean() >= COMMON
            ]
            partners.append(tuple(own))
        return cls(places, tuple(partners))

    def cost(self, view: int, views: Sequence[int]) -> float:
        """How far a photo's partners in a group are away: the mean of d; 0 without any."""
        others = [u for u in views if u != view]
        return float(np.linalg.norm(self.places[others] - self.places[view], axis=1).mean()) if others else 0.0

    def own_group(self, view: int, size: int = GROUP) -> tuple[int, ...]:
        """A photo and its nearest partners, `size` in all, which stand at different places; rising."""
        group = [view]
        for u in self.partners[view]:
            apart = np.linalg.norm(self.places[group, :3] - self.places[u, :3], axis=1)
            if len(group) < size and (apart >= LEAST_BASELINE).all():
                group.append(u)
        return tuple(sorted(group))

    def parts(self) -> list[list[int]]:
        """Photos of one place each: those that partners join, however many lie between them; by their first."""
        beside: list[set[int]] = [set(partners) for partners in self.partners]
        for v, partners in enumerate(self.partners):
            for u in partners:
                beside[u].add(v)
        return joined(beside)


def joined(beside: Sequence[Iterable[int]]) -> list[list[int]]:
    """Parts of a graph, rising, whose nodes lead to one another; `beside` are each node's neighbours, both ways."""
    parts, left = [], set(range(len(beside)))
    while left:
        part, new = set[int](), {min(left)}
        while new:
            part |= new
            new = set().union(*(beside[v] for v in new)) - part
        parts.append(sorted(part))
        left -= part
    return parts


def view_places(cameras: Sequence[Camera], near: float, far: float) -> NDArray:
    """(V, 6) float64: centres in units of the scene's depth, and directions, so that |p₁ − p₂| is d."""
    depth = 2 / (1 / near + 1 / far)
    centres = np.stack([camera.centre for camera in cameras]) / depth
    return np.concatenate([centres, np.stack([camera.rotation[2] for camera in cameras])], axis=1)


def nearest_views(cameras: Sequence[Camera], camera: Camera, depth: float, count: int) -> list[int]:
    """The views of least d from a camera, as many as are asked for or as there are, nearest first; D is `depth`."""
    places = view_places([*cameras, camera], depth, depth)
    distances = np.square(places[:-1] - places[-1]).sum(axis=1)
    return [int(view) for view in np.argsort(distances, kind="stable")[:count]]


def spread(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """Of cameras, in their order, at most as many as are asked for that lie far from one another, each place once.

    Taken one after another, the farthest from all before it, as distances between their places, in units of how far
    these lie apart, and between directions are.
    """
    if not cameras:
        return []
    centres = np.stack([camera.centre for camera in cameras])
    reach = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()) or 1.0
    places = view_places(cameras, reach, reach)
    chosen = [int(np.argmin(np.square(places - places.mean(axis=0)).sum(axis=1)))]
    away = np.full(len(places), np.inf)
    while len(chosen) < count:
        away = np.minimum(away, np.square(places - places[chosen[-1]]).sum(axis=1))
        if not away.max() > 1e-12:
            break
        chosen.append(int(np.argmax(away)))
    return [cameras[number] for number in sorted(chosen)]


def grouped(neighbours: Neighbours, size: int = GROUP, least: int = 2, shared: float = np.inf) -> list[Group]:
    """Groups in which every photo is kept once, but those that have too few partners; by the first that they keep.

    Args:
        neighbours: of all photos.
        size: photos of a group at most.
        least: and at least.
        shared: photos whose own partners are farther away than that, the mean of d, are kept by their own groups.
    """
    candidates = [neighbours.own_group(v, size) for v in range(len(neighbours.partners))]
    costs = [{u: neighbours.cost(u, group) for u in group} for group in candidates]
    served = [
        {u for u in group if u == v or costs[v][u] <= SUITS * costs[u][u] <= SUITS * shared}
        if len(group) >= least
        else set()
        for v, group in enumerate(candidates)
    ]
    chosen = _cover(served, [sum(cost.values()) for cost in costs])
    kept: dict[int, list[int]] = {}
    for v in range(len(candidates)):
        own = [(costs[g][v], g) for g in chosen if v in costs[g]]
        if own:
            kept.setdefault(min(own)[1], []).append(v)
    return sorted((Group(candidates[g], tuple(views)) for g, views in kept.items()), key=lambda group: group.kept)


def _cover(sets: Sequence[set[int]], costs: Sequence[float]) -> list[int]:
    """Indices of sets that hold all there is in any: of those with most that is new the cheapest, one after another."""
    missing = set().union(*sets)
    queue = [(-len(members), costs[i], i) for i, members in enumerate(sets)]
    heapq.heapify(queue)
    chosen = []
    while missing:
        _, cost, i = heapq.heappop(queue)
        new = len(sets[i] & missing)
        if queue and (-new, cost, i) > queue[0]:
            heapq.heappush(queue, (-new, cost, i))
            continue
        chosen.append(i)
        missing -= sets[i]
    return chosen


def nearest_places(places: NDArray, count: int) -> NDArray:
    """(V, count) int64: the nearest other places of each, nearest first, of two at one distance the first."""
    nearest = np.empty((len(places), count), np.int64)
    for start in range(0, len(places), _ROWS):
        rows = np.arange(start, min(start + _ROWS, len(places)))
        squares = np.zeros((len(rows), len(places)))
        for axis in places.T:
            squares += np.square(axis[rows, None] - axis)
        squares[np.arange(len(rows)), rows] = np.inf
        nearest[rows] = np.argsort(squares, axis=1, kind="stable")[:, :count]
    return nearest
