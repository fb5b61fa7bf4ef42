"""The public door: Gaussians and the scene they were made of, to Gaussians that show it better."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ..codec.profiles import Profile
from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..render.gradient import MovableGaussians
from ..scene.scenes import Scene
from .loop import Loop
from .photos import matched, sizes_of
from .price import plane_prices
from .settings import STEPS, settings_for
from .stats import RefineStats

MAX_STEPS = 10_000

SAME_PICTURE = 0.25
"""Least share of a photo's variance, after gain and offset, that the Gaussians' picture has to explain at the start:
0.6 to 0.99 for photos they were made of, about 0 for photos of another scene."""


def refine(
    gaussians: Gaussians,
    scene: Scene,
    *,
    steps: int | None = None,
    seconds: float | None = None,
    profile: Profile,
    qp: float = 0.0,
    run_jobs: Callable,
    stats: RefineStats | None = None,
    show: Callable[..., Iterator[int]] | None = None,
) -> Gaussians:
    """Correct Gaussians until they show the photos that they were made of.

    Every step draws all photos, takes the gradient of what each lacks (L1, after a gain and an offset a photo) and
    moves every Gaussian of every layer along its pixel's ray, in size, opacity and colour. Now and then every photo is
    drawn from the Gaussians of the others: the result is the step at which that was best, and the very Gaussians that
    were given if none was better than the start.

    Args:
        gaussians: per pixel, with cameras, of two views or more.
        scene: the photos, found by their cameras' poses; those of twice the size are used where they are at hand.
        steps: how many to take at most; the same number gives the same result on any number of threads.
        seconds: for how long at most, in place of `steps`.
        profile, qp: what the result will be coded with: what bits of its planes are worth is counted in its steps.
        run_jobs: maps a function over a list, on any number of threads.
        stats: filled with what was done.
        show: passes an iterator of steps on, given it, how many there will be at most (None where time decides) and
            what says how things stand.

    Returns:
        Gaussians whose notes say how they were refined, or `gaussians`.

    Raises:
        InputError: photos that do not fit the Gaussians, or a budget out of range.
    """
    limit = _limit(steps, seconds)
    deadline = math.inf if seconds is None else time.perf_counter() + seconds
    refining = Refining(gaussians, scene, profile, qp, run_jobs, stats)
    taken = refining.advance(limit, deadline)
    for _ in show(taken, limit if seconds is None else None, refining.note) if show else taken:
        pass
    return refining.result()


class Refining:
    """Gaussians being refined, step by step.

    Attributes:
        stats: what was done so far.
    """

    def __init__(
        self, gaussians: Gaussians, scene: Scene, profile: Profile, qp: float, run_jobs: Callable,
        stats: RefineStats | None = None,
    ) -> None:  # fmt: skip
        """Begin; see `refine` for arguments and errors."""
        self.stats = stats if stats is not None else RefineStats()
        self._start, self._worse, self._score = gaussians, 0, -math.inf
        self._loop = _begin(gaussians, scene, profile, qp, run_jobs, self.stats)
        if self._loop is not None:
            self.stats.before = self._loop.photo_psnr()
            self._look()

    def advance(self, limit: int, deadline: float) -> Iterator[int]:
        """Take steps, up to a number of them in all or a `time.perf_counter()`; ends by itself once they do no good."""
        loop, stats = self._loop, self.stats
        if loop is None:
            return
        limit = min(limit, loop.settings.most_steps)
        while stats.steps < limit and time.perf_counter() < deadline and self._worse < loop.settings.patience:
            loop.step()
            stats.steps += 1
            if stats.steps % loop.settings.look_every == 0:
                self._look()
            yield stats.steps

    def note(self) -> str:
        """How things stand, in few words."""
        errors = self._loop.errors if self._loop else ()
        return f"photos {np.mean([error.psnr for error in errors]):.2f} dB" if errors else ""

    def result(self) -> Gaussians:
        """The best so far, with notes that say how they were refined; the start where nothing was better."""
        loop, stats, start = self._loop, self.stats, self._start
        if loop is None:
            return start
        if stats.looks[-1][0] != stats.steps:
            self._look()
        if stats.kept == 0:
            stats.reason = "no step made photos look better from the Gaussians of the others"
            return start
        present = loop.field.values.copy()
        loop.show(self._best)
        stats.after = loop.photo_psnr()
        refined = loop.field.gaussians(start)
        loop.show(present)
        if stats.after <= stats.before:
            stats.kept, stats.reason = 0, "no step made the photos themselves look better"
            return start
        text = f"{stats.kept} steps on {len(start.cameras)} photos: {stats.before:.1f} to {stats.after:.1f} dB"
        return refined.with_notes(replace(start.notes, refined=text))

    def _look(self) -> None:
        """See whether the present state is the best."""
        assert self._loop is not None
        check = self._loop.check()
        self.stats.looks.append((self.stats.steps, check))
        if check >= self._score + self._loop.settings.least_gain:
            self._score, self._best, self._worse = check, self._loop.field.values.copy(), 0
            self.stats.kept = self.stats.steps
        else:
            self._worse += 1


def _begin(
    gaussians: Gaussians, scene: Scene, profile: Profile, qp: float, run_jobs: Callable, stats: RefineStats
) -> Loop | None:
    """The loop before its first step; None, and the reason in `stats`, where photos show something else than they."""
    sizes = sizes_of(gaussians, matched(gaussians, scene))
    settings = settings_for(len(gaussians.cameras))
    moving = MovableGaussians(gaussians, run_jobs)
    for view, target in enumerate(sizes[0]):
        error = moving.measure(target, shares=moving.shares(target.camera))
        if 1 - error.squared / float(((target.photo - target.photo.mean((0, 1))) ** 2).sum() + 1e-9) < SAME_PICTURE:
            stats.reason = f"photo {view} shows something else than they do"
            return None
    return Loop(moving, sizes, plane_prices(gaussians, moving.grids, profile, qp, settings.price), settings, run_jobs)


def _limit(steps: int | None, seconds: float | None) -> int:
    if steps is not None and seconds is not None:
        raise InputError("given with steps, which contradicts it; expected one of them", where="seconds")
    if seconds is not None:
        if not 0 < seconds < 86_400:
            raise InputError(f"{seconds:g} s, expected more than 0 and less than a day", where="seconds")
        return MAX_STEPS
    steps = STEPS if steps is None else steps
    if isinstance(steps, bool) or not isinstance(steps, (int, np.integer)) or not 1 <= steps <= MAX_STEPS:
        raise InputError(f"{steps!r}, expected a whole number from 1 to {MAX_STEPS}", where="steps")
    return int(steps)
