"""Captures of more photos than a network takes: groups of neighbours, one after another, become one scene.

Besides the result, which waits on disk, there is one group in memory, of its photos too. Groups do not depend on each
other.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..graphs.inference import Graph
from ..scene.cameras import Camera
from ..scene.neighbours import GROUP, Group, Neighbours, grouped
from ..system import disk
from ..system.told import NOBODY, Told
from .predict import NetworkLimits, origin_of, predict


def capture_groups(
    cameras: Sequence[Camera], near: float, far: float, limits: NetworkLimits, shared: float = np.inf
) -> tuple[Group, ...]:
    """In which groups a network takes photos: all at once where it can; `shared` as for `neighbours.grouped`.

    Raises:
        InputError: a photo shows nothing that others do from other places.
    """
    views = tuple(range(len(cameras)))
    if len(views) <= limits.max_views:
        return (Group(views, views),)
    size = max(min(GROUP, limits.max_views), limits.min_views)
    groups = grouped(Neighbours.of(cameras, near, far), size, limits.min_views, shared)
    alone = sorted(set(views).difference(*(group.kept for group in groups)))
    if alone:
        who, them = f"photo {alone[0] + 1} shares", "it"
        if len(alone) > 1:
            who, them = f"photo {alone[0] + 1} and {len(alone) - 1} more share", "them"
        raise InputError(f"{who} nothing with the rest; leave {them} out with --views", where="cameras")
    return tuple(groups)


def predict_grouped(
    images: NDArray, cameras: Sequence[Camera], near: float, far: float, graph: Graph, groups: Sequence[Group]
) -> Gaussians:
    """As `predict.predict`, of photos (V, H, W, 3) in groups."""

    def run(views: Sequence[int]) -> Gaussians:
        of_all = len(views) == len(images)
        return predict(images if of_all else images[list(views)], [cameras[v] for v in views], near, far, graph)

    return predict_groups(cameras, near, groups, run)


def predict_groups(
    cameras: Sequence[Camera],
    near: float,
    groups: Sequence[Group],
    run: Callable[[Sequence[int]], Gaussians],
    told: Told = NOBODY,
    costs: Sequence[float] | None = None,
) -> Gaussians:
    """One scene of what a network makes of each group.

    Args:
        cameras: of all photos.
        near: depth of the nearest surface, scene units.
        groups: in which every photo is kept once.
        run: the network, of photos by their indices.
        told: is told of each photo.
        costs: of each against the others, where they are not alike.

    Returns:
        (V, H, W, …) Gaussians with cameras, further layers in `extra_layers`; the origin as for `predict.predict`.
    """
    if len(groups) == 1 and len(groups[0].kept) == len(cameras):
        return run(groups[0].views)
    origin = origin_of(cameras, near)
    joined: list[dict[str, NDArray]] = []
    seen_by: list[list[Any]] = []
    photos = [(group, place) for group in groups for place in range(len(group.kept))]
    for group, place in told.progress("Gaussians of photos", photos, costs=costs):
        if place:
            continue
        predicted = run(group.views)
        if not joined:
            joined = [
                {name: disk.zeros((len(cameras), *getattr(layer, name).shape[1:])) for name in FIELDS}
                for layer in predicted.layers
            ]
            seen_by = [[None] * len(cameras) for _ in joined]
        shift = predicted.origin - origin
        for layer, arrays, its in zip(predicted.layers, joined, seen_by, strict=True):
            for view in group.kept:
                at = group.views.index(view)
                for name in FIELDS:
                    arrays[name][view] = getattr(layer, name)[at]
                if shift.any():
                    arrays["means"][view] = layer.means[at] + shift
                its[view] = layer.cameras[at]
    layers = [
        Gaussians.unchecked(**arrays, cameras=tuple(its), origin=origin)
        for arrays, its in zip(joined, seen_by, strict=True)
    ]
    return Gaussians.stacked(layers)
