"""Which photos show another scene than the others, or have another's camera: nothing should be learnt from them.

Three things tell a stranger. The Gaussians of the other photos do not show it. Drawn with its own, they still do not,
as they stand before or beside these. And its neighbours are shown better without it. A photo that looks where few
others do has the first in common with strangers, but neither of the others. How alike a picture is does not depend on
exposure: a photo two stops darker than the others is none. Measured in docs/lab/strangers.md.
"""

import math
from collections.abc import Collection
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians
from ..list.training.photos import targets_of
from ..render import Renderer
from ..scene.neighbours import nearest_places, view_places
from ..scene.scenes import Scene
from ..system.told import NOBODY, Told

LEAST_ALIKE, LEAST_OWN = 0.45, 0.85
"""How alike a photo and its picture are at least, drawn from the Gaussians of the others and from all. A photo is
doubted that has less of both; from the others, no photo has more than 1."""

MOST_HARM = 0.05
"""Most that one neighbour counts: it may be a stranger of the same scene, which is shown worse."""

MOST_OUT = 0.25
"""Share of the photos that are strangers at most; a single one may always be."""

SHOWING = 4
"""Photos whose Gaussians show one, itself among them unless it is left out: the nearest."""

COVERED = 0.6
"""A pixel counts where Gaussians are at least so opaque."""

MOST_PIXELS = 1 << 17
"""Photos that have more are compared at this size."""

TILE = 8
"""Pixels of a side of the tiles in which they are compared."""

EVEN = 0.01
"""Standard deviation of a colour in a tile that counts as noise."""


def strangers(gaussians: Gaussians, scene: Scene, threads: int | None = None, told: Told = NOBODY) -> tuple[int, ...]:
    """The photos that the others contradict, in order; none where they would be many, and of two photos.

    Args:
        gaussians: per pixel, of all photos.
        scene: the photos.
        threads: how many to use, None for one per available core.
        told: is told of each photo.

    Raises:
        InputError: a photo that cannot be read.
    """
    count, out = len(scene.frames), frozenset[int]()
    if count <= 2:
        return ()
    sight = _Sight(gaussians, scene, threads)
    while True:
        left = [view for view in range(count) if view not in out]
        looked_at = left if out else told.progress("comparing neighbours", left)
        apart = {view: sight.alike(view, out | {view}) for view in looked_at}
        own = {view: sight.alike(view, out) for view in left if apart[view] < LEAST_ALIKE}
        doubted = [view for view in own if own[view] < LEAST_OWN]
        harm = {view: sight.harm(view, out, doubted) for view in doubted}
        harmful = [view for view in doubted if harm[view] > 0]
        unlike = [view for view in doubted if own[view] < LEAST_ALIKE]  # by a wrong photo of good Gaussians
        if not harmful and not unlike:
            return tuple(sorted(out))
        worst = max(harmful, key=lambda view: harm[view]) if harmful else min(unlike, key=lambda view: own[view])
        out |= {worst}
        if len(out) > max(1, int(MOST_OUT * count)):
            return ()


class _Sight:
    """How the Gaussians of some photos show one; the same picture is drawn once."""

    def __init__(self, gaussians: Gaussians, scene: Scene, threads: int | None) -> None:
        camera = scene.cameras[0]
        share = min(math.sqrt(MOST_PIXELS / (camera.width * camera.height)), 1)
        if share < 1:
            scene = scene.resized(round(share * camera.height), round(share * camera.width))
        self._gaussians, self._threads = gaussians, threads
        self._targets = targets_of(scene.cameras, scene.frames)
        places = view_places(scene.cameras, *scene.depth_range())
        self._nearest = nearest_places(places, len(places) - 1).tolist()
        self._known = dict[tuple[int, tuple[int, ...]], float]()

    def alike(self, view: int, without: Collection[int]) -> float:
        """`likeness` of a photo and its picture from the Gaussians of those near it but some."""
        key = view, self._near(view, without)
        if key not in self._known:
            near, target = select_views(self._gaussians, key[1]), self._targets[view]
            renderer = Renderer(near, self._threads, keep=False)
            shown = renderer.render(target.camera, outputs=("rgb", "alpha"))
            known = (shown["alpha"] >= COVERED) & np.isfinite(target.photo[..., 0])
            self._known[key] = likeness(shown["rgb"], target.photo, known)
        return self._known[key]

    def harm(self, view: int, without: Collection[int], doubted: Collection[int]) -> float:
        """By how much its neighbours are shown better without a photo's Gaussians; of those that are doubted too, those
        that nobody would doubt then.
        """
        gains = []
        for other in range(len(self._targets)):
            if other in without or view not in self._near(other, {*without, other}):
                continue
            if not self._near(other, {*without, other, view}):
                continue  # of the two that are left
            then = self.alike(other, {*without, other, view})
            if other not in doubted or then >= LEAST_ALIKE:
                gains.append(then - self.alike(other, {*without, other}))
        return float(np.clip(gains, -MOST_HARM, MOST_HARM).mean()) if gains else 0.0

    def _near(self, view: int, without: Collection[int]) -> tuple[int, ...]:
        """The photos whose Gaussians show one, but some, in order."""
        near = (other for other in (view, *self._nearest[view]) if other not in without)
        return tuple(sorted(islice(near, SHOWING)))


def likeness(picture: NDArray, photo: NDArray, known: NDArray) -> float:
    """How alike two pictures (H, W, 3) are where both are known (H, W): the correlation within tiles of each colour,
    weighted by their contrasts, from −1 to 1. Tiles that are even in both are alike, those even in one are not.
    """
    one, other = (_tiles(np.where(known[..., None], image, 0)) for image in (picture, photo))
    counted = _tiles(known[..., None])
    pixels = np.maximum(counted.sum(axis=1, keepdims=True), 1)
    one, other = (counted * (tiles - tiles.sum(axis=1, keepdims=True) / pixels) for tiles in (one, other))
    noise = EVEN**2 * counted.sum(axis=1)
    contrasts = (np.square(tiles).sum(axis=1) + noise for tiles in (one, other))
    weight = float(np.sqrt(np.prod(list(contrasts), axis=0)).sum())
    return float(((one * other).sum(axis=1) + noise).sum()) / weight if weight > 0 else 0.0


def _tiles(image: NDArray) -> NDArray:
    """(tiles, pixels of each, colours) float64 of a picture (H, W, C); pixels beyond whole tiles are left out."""
    rows, columns, colours = image.shape[0] // TILE, image.shape[1] // TILE, image.shape[2]
    whole = image[: rows * TILE, : columns * TILE].reshape(rows, TILE, columns, TILE, colours)
    return whole.transpose(0, 2, 1, 3, 4).reshape(rows * columns, TILE * TILE, colours).astype(np.float64)
