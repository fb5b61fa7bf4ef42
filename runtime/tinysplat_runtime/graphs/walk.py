"""Captures of more photos than a network takes: groups of neighbours, one after another, become one scene.

Besides the result there is one group in memory, of its photos too. Groups do not depend on each other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..scene.neighbours import GROUP, Group, Neighbours, grouped
from ..scene.scenes import Scene
from .predict import FAR_FROM_ORIGIN, Limits

Show = Callable[[Iterable[Any], int, Callable[[], str]], Iterator[Any]]
"""Yields the items it is given, of which there are so many, and shows how far it is; a word is added."""


def plain(items: Iterable[Any], total: int, note: Callable[[], str]) -> Iterator[Any]:
    """A `Show` that shows nothing."""
    return iter(items)


def capture_groups(scene: Scene, limits: Limits) -> list[Group]:
    """In which groups a network takes the photos of a scene: all at once where it can.

    Raises:
        InputError: the scene states no depth range, or a photo shows nothing that others do from other places.
    """
    views = tuple(range(len(scene.frames)))
    if len(views) <= limits.max_views:
        return [Group(views, views)]
    size = max(min(GROUP, limits.max_views), limits.min_views)
    groups = grouped(Neighbours.of(scene.cameras, *scene.depth_range()), size, limits.min_views)
    alone = sorted(set(views).difference(*(group.kept for group in groups)))
    if alone:
        found = f"photo {alone[0]} shows nothing that others do from another place"
        more = f", and {len(alone) - 1} more" if len(alone) > 1 else ""
        raise InputError(f"{found}{more}; leave out what matches nothing", where=str(scene.path))
    return groups


def predict_groups(
    scene: Scene, groups: Sequence[Group], predict: Callable[[Scene], Gaussians], show: Show = plain
) -> Gaussians:
    """One scene of what a network makes of each group.

    Args:
        scene: with near and far; photos are read group by group.
        groups: in which every photo is kept once.
        predict: runs the network on the photos of one group.
        show: is given a photo at a time.

    Returns:
        (V, H, W, …) Gaussians with cameras, further layers in `extra_layers`; the origin as for `predict.predict`.
    """
    if len(groups) == 1 and len(groups[0].kept) == len(scene.frames):
        return predict(scene)
    origin = _origin(scene)
    joined: list[dict[str, NDArray]] = []
    cameras: list[list[Any]] = []
    photos = [(group, place) for group in groups for place in range(len(group.kept))]
    for group, place in show(photos, len(photos), str):
        if place:
            continue
        found = predict(scene.views(group.views))
        if not joined:
            views = len(scene.frames)
            joined = [_empty(layer, views) for layer in found.layers]
            cameras = [[None] * views for _ in joined]
        shift = found.origin - origin
        for layer, arrays, seen_by in zip(found.layers, joined, cameras, strict=True):
            for view in group.kept:
                at = group.views.index(view)
                for name in FIELDS:
                    arrays[name][view] = getattr(layer, name)[at]
                if shift.any():
                    arrays["means"][view] = layer.means[at] + shift
                seen_by[view] = layer.cameras[at]
    layers = [
        Gaussians.unchecked(**arrays, cameras=tuple(seen_by), origin=origin)
        for arrays, seen_by in zip(joined, cameras, strict=True)
    ]
    return Gaussians.unchecked(**{**vars(layers[0]), "extra_layers": tuple(layers[1:])})


def _origin(scene: Scene) -> NDArray:
    """(3,) float64: the world's own, or the middle of a capture that lies far from it."""
    centres = np.stack([camera.centre for camera in scene.cameras])
    near, _ = scene.depth_range()
    is_far = np.linalg.norm(centres, axis=1).max() > FAR_FROM_ORIGIN * near
    return centres.mean(axis=0) if is_far else np.zeros(3)


def _empty(layer: Gaussians, views: int) -> dict[str, NDArray]:
    return {name: np.empty((views, *getattr(layer, name).shape[1:]), np.float32) for name in FIELDS}
