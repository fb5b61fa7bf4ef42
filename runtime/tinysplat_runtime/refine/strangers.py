"""Which photos show another scene than the others, or have another's camera: nothing should be learnt from them.

Three things tell a stranger. The Gaussians of the other photos do not show it. Drawn with its own, they still do not,
as they stand before or beside these. And its neighbours are shown better without it. A photo that looks where few
others do has the first in common with strangers, but neither of the others. How alike a picture is does not depend on
exposure: a photo two stops darker than the others is none. Measured in docs/lab/refine.md. Needs numba.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..render.gradient import MovableGaussians, Target
from ..system.told import NOBODY, Told
from .photos import COVERED, in_parts

LEAST_ALIKE, LEAST_OWN = 0.45, 0.85
"""How alike a photo and its picture are at least, drawn from the Gaussians of the others and from all. A photo is
doubted that has less of both; from the others, no photo has more than 1."""

MOST_HARM = 0.05
"""Most that one neighbour counts: it may be a stranger of the same scene, which is shown worse."""

MOST_OUT = 0.25
"""Share of the photos that are strangers at most; a single one may always be."""

TILE = 8
"""Pixels of a side of the tiles in which they are compared."""


EVEN = 0.01
"""Standard deviation of a colour in a tile that counts as noise."""


def strangers(field: MovableGaussians, targets: Sequence[Target], told: Told = NOBODY) -> tuple[int, ...]:
    """The photos that the others contradict, in order; none where they would be many, both of two.

    Args:
        field: the Gaussians of all photos.
        targets: the photos.
        told: is told of each photo.
    """
    sight, out = _Sight(field, targets), frozenset[int]()
    if len(targets) == 2:
        views = told.progress("comparing neighbours", (0, 1))
        by_other, by_both = zip(*((sight.alike(view, {view}), sight.alike(view, ())) for view in views), strict=True)
        return (0, 1) if max(by_other) < LEAST_ALIKE and min(by_both) < LEAST_OWN else ()
    most = max(1, int(MOST_OUT * len(targets)))
    while True:
        left = [view for view in range(len(targets)) if view not in out]
        looked_at = left if out else told.progress("comparing neighbours", left)
        apart = {view: sight.alike(view, out | {view}) for view in looked_at}
        own = {view: sight.alike(view, out) for view in left if apart[view] < LEAST_ALIKE}
        doubted = [view for view in own if own[view] < LEAST_OWN]
        harm = {view: sight.harm(view, out, doubted) for view in doubted}
        harmful = [view for view in doubted if harm[view] > 0]
        unlike = [view for view in doubted if own[view] < LEAST_ALIKE]  # by a wrong photo of good Gaussians
        if not harmful and not unlike:
            break
        worst = max(harmful, key=lambda view: harm[view]) if harmful else min(unlike, key=lambda view: own[view])
        out |= {worst}
        if len(out) > most:
            return ()
    return tuple(sorted(out))


class _Sight:
    """How the Gaussians of some photos show one; the same picture is drawn once."""

    def __init__(self, field: MovableGaussians, targets: Sequence[Target]) -> None:
        self._field = field
        self._targets = [replace(target, photo=in_parts(target.photo, view)) for view, target in enumerate(targets)]
        self._known = dict[tuple[int, bytes], float]()

    def alike(self, view: int, without: Collection[int]) -> float:
        """`likeness` of a photo and its picture from the Gaussians of all photos but some."""
        target, shares = self._targets[view], self._field.shares(self._targets[view].camera, without)
        key = view, shares.whole.tobytes()
        if key not in self._known:
            shown = np.ones((*target.photo.shape[:2], 4), np.float32)
            self._field.measure(target, shares=shares, shown=shown)
            known = (shown[..., 3] <= COVERED) & np.isfinite(target.photo[..., 0])
            self._known[key] = likeness(shown[..., :3], target.photo, known)
        return self._known[key]

    def harm(self, view: int, without: Collection[int], doubted: Collection[int]) -> float:
        """By how much its neighbours, but those that are doubted too, are shown better without a photo's Gaussians."""
        gains = []
        for other, target in enumerate(self._targets):
            if other in doubted or other in without:
                continue
            if self._field.shares(target.camera, {*without, other}).whole[view] > 0:
                gains.append(self.alike(other, {*without, other, view}) - self.alike(other, {*without, other}))
        return float(np.clip(gains, -MOST_HARM, MOST_HARM).mean()) if gains else 0.0


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
