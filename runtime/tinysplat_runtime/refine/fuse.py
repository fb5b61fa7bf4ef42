"""A capture as Gaussians that any viewer draws: thinned, and moved until pictures fit again.

Other viewers know neither views nor which of them are near. What our own drawing shows from the places of the views and
from halfway between them is what they should show too. So every step draws one of these pictures as 3DGS defines, takes
the gradient of its error (L1), and moves, scales, fades and colours all Gaussians by Adam; those that have faded go.
Needs numba (`tinysplat[fast]`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian import FUSE_SECONDS
from ..gaussian.gaussians import Gaussians
from ..gaussian.thin import thinned
from ..render import between
from ..render.gradient import Target
from ..render.near import NearViews
from ..render.renderer import Renderer
from ..scene.cameras import Camera
from ..scene.neighbours import view_places
from ..system.threads import Crew, available_cores
from ..system.told import NOBODY, Told
from .descent import Descent, Pace, units
from .free import FreeGaussians

PARTNERS = 2
"""Views nearest to each, halfway to which pictures are drawn."""

COVERED = 0.9
"""Pixels of a drawn picture that are less opaque say nothing."""

FADED = 0.02
"""Gaussians of less opacity go."""


@dataclass
class FuseStats:
    """What was done.

    Attributes:
        given, thinned, kept: Gaussians at the start, after thinning, and at the end.
        steps: how many were taken.
        rounds: dB of the pictures of every round, as each was just before its step.
    """

    given: int = 0
    thinned: int = 0
    kept: int = 0
    steps: int = 0
    rounds: list[list[float]] = field(default_factory=list)

    def note(self) -> str:
        """How things stand, in few words."""
        return f"pictures {np.nanmean(self.rounds[-1]):.2f} dB" if self.rounds else ""

    @property
    def text(self) -> str:
        """In a line."""
        first, last = (np.nanmean(dBs) for dBs in (self.rounds[0], np.concatenate(self.rounds[-2:])))
        found = f"{self.given} Gaussians thinned to {self.thinned} and fused to {self.kept} in {self.steps} steps"
        return f"{found}: pictures of our own drawing {first:.1f} to {last:.1f} dB"


def fused(
    gaussians: Gaussians,
    *,
    seconds: float | None = None,
    steps: int | None = None,
    threads: int | None = None,
    pace: Pace | None = None,
    stats: FuseStats | None = None,
    told: Told = NOBODY,
) -> Gaussians:
    """Gaussians that show a capture where all of them are drawn, as 3DGS defines.

    Args:
        gaussians: per pixel, with cameras, of two views or more.
        seconds: for how long, thinned Gaussians once at hand; without it and `steps`, `FUSE_SECONDS`.
        steps: how many, in place of `seconds`; the same number gives the same result on any number of threads.
        threads: how many to use, None for one per available core.
        pace: how they are corrected.
        stats: filled with what was done.
        told: is told of each step.

    Returns:
        (N,) Gaussians of SH degree 0 or 1.

    Raises:
        InputError: Gaussians of no pixels or of one view, or a budget out of range.
    """
    if len(gaussians.cameras) < 2:
        found = f"{len(gaussians.cameras)} views, expected per-pixel Gaussians of two or more"
        raise InputError(found, where="gaussians")
    limit = _seconds(seconds, steps)
    stats = stats if stats is not None else FuseStats()
    fusing = _Fusing(gaussians, threads, pace or Pace(), stats)
    begin = time.perf_counter()

    def way() -> float:
        return stats.steps / steps if steps else (time.perf_counter() - begin) / limit

    for _ in told.progress("fuse", fusing.advance(way), stats.note):
        pass
    return fusing.result()


def _seconds(seconds: float | None, steps: int | None) -> float:
    """For how long, if not for so many steps."""
    if steps is not None:
        if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1 or seconds is not None:
            raise InputError(f"{steps!r}, expected a whole number above 0, and no seconds beside it", where="steps")
        return math.inf
    seconds = FUSE_SECONDS if seconds is None else seconds
    if not 0 < seconds < 86_400:
        raise InputError(f"{seconds:g} s, expected more than 0 and less than a day", where="seconds")
    return seconds


class _Fusing:
    """Gaussians on their way, and the pictures that they are to show."""

    def __init__(self, gaussians: Gaussians, threads: int | None, pace: Pace, stats: FuseStats) -> None:
        self._run = Crew(threads or available_cores()).map
        self._pictures, self._pace, self._stats = _OwnPictures(gaussians, threads), pace, stats
        thin = thinned(gaussians, self._run, shown=1)
        thin = replace(thin, sh=thin.sh[:, :4])
        stats.given, stats.thinned = gaussians.count, thin.count
        field = FreeGaussians(thin, units(thin, gaussians.cameras), self._run)
        self._descent = Descent(field, self._pace, self._run)

    def advance(self, way: Callable[[], float]) -> Iterator[int]:
        """Take steps, one at least, until there is no way left."""
        order, stats, looks = np.random.default_rng(0), self._stats, 1
        left: list[int] = []
        while (done := way()) < 1 or not stats.steps:
            if not left:
                left = order.permutation(len(self._pictures)).tolist()
                stats.rounds.append([])
            if done * self._pace.looks >= looks:
                self._drop_faded()
                looks += 1
            stats.rounds[-1].append(self._descent.step(self._pictures[left.pop()], done).psnr)
            stats.steps += 1
            yield stats.steps

    def result(self) -> Gaussians:
        """As they stand."""
        self._drop_faded()
        self._stats.kept = self._descent.field.count
        return self._descent.field.gaussians()

    def _drop_faded(self) -> None:
        keep = self._descent.field.opacities >= FADED
        if keep.any() and not keep.all():
            self._descent.keep(keep)


class _OwnPictures:
    """What our own drawing shows from every view and halfway to its nearest, drawn when first asked for."""

    def __init__(self, gaussians: Gaussians, threads: int | None) -> None:
        views = NearViews.of(gaussians)
        assert views is not None  # there are two or more
        self._renderer, self._cameras = Renderer(gaussians, threads), _cameras(gaussians.cameras, views.depth)
        self._drawn: dict[int, NDArray] = {}

    def __len__(self) -> int:
        return len(self._cameras)

    def __getitem__(self, number: int) -> Target:
        camera = self._cameras[number]
        if number not in self._drawn:
            seen = self._renderer.render(camera, outputs=("rgb", "alpha"))
            is_known = seen["alpha"][..., None] >= COVERED
            self._drawn[number] = np.where(is_known, seen["rgb"], np.float32(np.nan)).astype(np.float16)
        return Target(camera, self._drawn[number].astype(np.float32))


def _cameras(views: Sequence[Camera], depth: float) -> list[Camera]:
    """The views, and halfway from each to the nearest; `depth` is the scene's."""
    places, pairs = view_places(views, depth, depth), set()
    for view in range(len(views)):
        distances = np.square(places - places[view]).sum(axis=1)
        distances[view] = np.inf
        nearest = np.argsort(distances, kind="stable")[: min(PARTNERS, len(views) - 1)].tolist()
        pairs |= {(min(view, other), max(view, other)) for other in nearest}
    return [*views, *(between([views[first], views[second]], 3)[1] for first, second in sorted(pairs))]
