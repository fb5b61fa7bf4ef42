"""Corners that three photos of a capture agree on.

`scene.matches` finds corners that look alike in two photos and lie where the cameras allow. One that a photo shares
with two others at nearly one depth has a depth that needs no measured one to be right: the one that puts it nearest to
where these photos show it (Gauss–Newton over inverse depth). They are the easiest pixels of a photo.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.matches import corners, depths_of, matched
from tinysplat_runtime.scene.neighbours import nearest_places, view_places
from tinysplat_runtime.scene.scenes import Scene

PARTNERS = 8
"""Nearest photos that a photo's corners are looked for in."""

LEAST_SEEN, ALIKE = 2, 1.3
"""Other photos that have to show a corner, and how many times the least of their depths the greatest may be."""

ROUNDS = 10


def agreed_corners(scene: Scene) -> list[tuple[NDArray, NDArray]]:
    """Pixels (N, 2), x first, of corners of every photo of a scene with near and far, and (N,) inverse depths."""
    cameras = scene.cameras
    found = [corners(frame.image()) for frame in scene.frames]
    nearest = nearest_places(view_places(cameras, *scene.depth_range()), min(PARTNERS, len(cameras) - 1))
    return [_of_photo(i, partners.tolist(), found, cameras) for i, partners in enumerate(nearest)]


def _of_photo(own: int, partners: Sequence[int], found: Sequence, cameras: Sequence[Camera]) -> tuple[NDArray, NDArray]:
    camera, places = cameras[own], found[own].places
    seen, depths = np.full((len(places), len(partners), 2), np.nan), np.full((len(places), len(partners)), np.nan)
    index = {tuple(place): n for n, place in enumerate(places)}
    at, by = np.empty((*depths.shape, 3)), np.empty((*depths.shape, 3))
    rays = np.column_stack([places, np.ones(len(places))]) @ np.linalg.inv(camera.K).T
    for n, other in enumerate(cameras[partner] for partner in partners):
        pairs = matched(found[own], found[partners[n]])
        rows = [index[tuple(place)] for place in pairs[:, :2]]
        depths[rows, n] = depths_of(pairs, camera, other)
        seen[rows, n] = pairs[:, 3:5]
        turn = other.K @ other.rotation
        at[:, n], by[:, n] = rays @ (turn @ camera.rotation.T).T, turn @ (camera.centre - other.centre)
    seen[np.isnan(depths)] = np.nan
    low, high = (
        pick(depths, axis=1, initial=start, where=depths > 0) for pick, start in ((np.min, np.inf), (np.max, 0))
    )
    agreed = (np.count_nonzero(depths > 0, axis=1) >= LEAST_SEEN) & (high <= ALIKE * low)
    places, seen, at, by, depths = (array[agreed] for array in (places, seen, at, by, depths))
    inverse = 1 / np.nanmedian(depths, axis=1) if len(depths) else np.empty(0)
    for _ in range(ROUNDS):
        point = at + inverse[:, None, None] * by  # homogeneous pixels in the partners
        shown, z = point[..., :2] / point[..., 2:], point[..., 2:]
        rest = np.nan_to_num(shown - seen)
        slope = np.where(np.isnan(seen), 0, (by[..., :2] - shown * by[..., 2:]) / z)
        inverse = inverse - (slope * rest).sum(axis=(1, 2)) / ((slope * slope).sum(axis=(1, 2)) + 1e-12)
    ahead = inverse > 0
    return places[ahead], inverse[ahead]
