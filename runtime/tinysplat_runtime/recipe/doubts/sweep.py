"""Colours over depths: a range in which nothing matches, or that a scene fills a small part of.

Depths that are nearer or farther make up for much that is wrong with cameras, so this is asked last, and only of what
corners do not tell.
"""

from collections.abc import Sequence

import numpy as np

from ...scene.look import BestDepths, all_best_depths, consistency, neighbours
from .seen import AGREEING, Seen

HARDLY = 0.1
"""Share of pixels that tell their depth: of all photos less than this, and they hardly match anywhere, as in a fifth of
ranges that are ten times too far."""

EMPTY = 4.0
"""A range is far too wide where most pixels lie so many times as far away as near: nothing is near `near`. From the air
some begin at 2.5 times, and one room of a range stated for its whole capture at 3.1 times, where a fitting range gains
nothing."""


def range_doubts(seen: Seen) -> list[str]:
    """A depth range in which nothing matches, or one that the scene fills a small part of."""
    near, far = seen.depths[0], seen.depths[-1]
    if np.ptp([camera.centre for camera in seen.cameras], axis=0).max() <= 1e-6 * near:
        return []  # no range would do from one place, which the network refuses in words of its own
    views = all_best_depths(seen.images, seen.cameras, seen.depths)
    if not _match(seen, views):
        views = all_best_depths(seen.evened, seen.cameras, seen.depths)
    if not _match(seen, views):
        if seen.confirmed:
            return []  # most overlap too little for a depth, but what they have in common is where cameras say
        who = " and ".join(seen.names) if len(seen.names) == 2 else "the photos"
        apart = [v for v in seen.closer if sum(seen.shares[pair] for pair in seen.places if v in pair) < 1]
        names = f"; {', '.join(seen.names[v] for v in apart[:3])} share no corner with others" if apart else ""
        range_ = f"at any depth from {near:g} to {far:g}"
        return [f"{who} do not match {range_}{names}: too little overlap, other places, or wrong poses or depths"]
    if seen.is_estimated:
        return []
    best = np.concatenate([found.best[found.confident] for found in views])
    low, high = np.percentile(best, (10, 90))
    shown = seen.depths[round(low)], seen.depths[round(high)]
    if shown[0] < EMPTY * near:
        return []
    extent = f"{shown[0]:.3g} to {shown[1]:.3g}"
    return [f"near {near:g} and far {far:g} reach far beyond what the photos show, most of it from {extent}"]


def _match(seen: Seen, views: Sequence[BestDepths]) -> bool:
    """Whether pixels tell their depth, and any photo most often the depth that the one nearest to it has, too."""
    cameras = seen.cameras
    nearest = enumerate(neighbours(cameras)[:, 0])
    alike = max(consistency(views[v], cameras[v], views[u], cameras[u]) for v, u in nearest)
    return alike >= AGREEING and max(view.confident.mean() for view in views) >= HARDLY
