"""A sparse scene: Gaussians of a capture's pixels, a few for all photos, corrected until they show these.

Every step draws a photo as 3DGS defines, takes the gradient of what it lacks, and moves, turns, scales, fades and
colours all Gaussians by Adam. Photos are small at first. Now and then Gaussians that show nothing go, and pixels where
photos still lack something give new ones. Photos may differ in exposure: each has a gain.
Needs numba (`tinysplat[fast]`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians, joined
from ..refine.coarse import halved_target
from ..refine.descent import Descent, units
from ..refine.exposed import log_gain
from ..refine.free import FreeGaussians
from ..render import DEFINITION, Renderer
from ..render.gradient import Target
from ..scene.cameras import Camera
from ..system.threads import Crew, available_cores
from ..system.told import NOBODY, Told
from . import DEFAULT_GAUSSIANS, DEFAULT_SECONDS, start, usual_steps
from .settings import Budget, Settings

COSTS = {4: 1.0, 2: 1.5, 1: 3.0}
"""Of steps on photos so many times smaller, against each other."""


@dataclass
class TrainStats:
    """What was done.

    Attributes:
        given, kept: Gaussians of the capture, and at the end.
        steps, planned: how many were taken, and how many there would have been with more seconds.
        rounds: dB of the photos of every round, as each was just before its step, at the size that it then had.
        psnr: dB of each photo at the end, as it was exposed.
        gains: of the photos.
    """

    given: int = 0
    kept: int = 0
    steps: int = 0
    planned: int = 0
    rounds: list[list[float]] = field(default_factory=list)
    psnr: tuple[float, ...] = ()
    gains: tuple[float, ...] = ()

    def note(self) -> str:
        """How things stand, in few words."""
        seen = next((one for one in reversed(self.rounds) if one), None)
        return f"photos {np.nanmean(seen):.2f} dB" if seen else ""

    @property
    def is_cut_short(self) -> bool:
        """Whether seconds ended it, not steps."""
        return self.steps < self.planned

    @property
    def text(self) -> str:
        """In a line."""
        found = f"{self.given:,} Gaussians made {self.kept:,} in {self.steps} steps"
        bound = f" of {self.planned}, as there were no more seconds" if self.is_cut_short else ""
        return f"{found}{bound}: {np.mean(self.psnr):.1f} dB at the pictures they were corrected by"


def trained(
    capture: Gaussians,
    targets: Sequence[Target],
    budget: Budget | None = None,
    *,
    threads: int | None = None,
    settings: Settings | None = None,
    stats: TrainStats | None = None,
    told: Told = NOBODY,
) -> Gaussians:
    """A list of Gaussians that shows photos, drawn as 3DGS defines.

    Args:
        capture: per pixel, with cameras, of the same photos, two or more.
        targets: the photos, by view; their gain is found, their offset 0.
        budget: how many Gaussians, steps and seconds there may be.
        threads: how many to use, None for one per available core.
        settings: how Gaussians are corrected.
        stats: filled with what was done.
        told: is told of each step.

    Returns:
        (N,) Gaussians of SH degree 0, 1 or 2, whose viewpoints the cameras of the photos are.

    Raises:
        InputError: Gaussians of no pixels or of one view, or other photos.
    """
    if len(capture.cameras) < 2 or len(targets) != len(capture.cameras):
        found = f"{len(capture.cameras)} views and {len(targets)} photos, expected per-pixel Gaussians of two or more"
        raise InputError(f"{found} and as many photos", where="capture")
    budget = budget or Budget()
    clock = _Clock.of(budget, len(targets))
    stats = stats if stats is not None else TrainStats()
    settings = settings or Settings()
    training = _Training(capture, targets, budget.gaussians or DEFAULT_GAUSSIANS, threads, settings, stats)
    costs = [COSTS[settings.smaller(step / clock.steps)] for step in range(clock.steps)]
    for _ in told.progress("training", training.advance(clock), stats.note, clock.steps, costs):
        pass
    return training.result()


@dataclass
class _Clock:
    """Steps, and seconds from now on that bound them."""

    steps: int
    seconds: float
    begun: float

    @classmethod
    def of(cls, budget: Budget, photos: int) -> _Clock:
        return cls(budget.steps or usual_steps(photos), budget.seconds or DEFAULT_SECONDS, time.perf_counter())

    def left(self, done: int) -> int:
        """How many steps there will have been, if seconds go on passing as they did."""
        taken = time.perf_counter() - self.begun
        return done if taken >= self.seconds else min(self.steps, math.ceil(done * self.seconds / taken))


class _Training:
    """Gaussians on their way, and the photos that they are to show."""

    def __init__(
        self,
        capture: Gaussians,
        targets: Sequence[Target],
        count: int,
        threads: int | None,
        settings: Settings,
        stats: TrainStats,
    ) -> None:
        self._capture, self._count, self._settings, self._stats = capture, count, settings, stats
        self._threads, self._run = threads, Crew(threads or available_cores()).map
        halves = [halved_target(target) for target in targets]
        quarters = [halved_target(half) for half in halves]
        self._sizes = {4: quarters, 2: halves, 1: list(targets)}
        self._gains = np.ones(len(targets))
        self._rng = np.random.default_rng(0)
        photos, least = [target.photo for target in targets], max(1, round(settings.start * count))
        begun = start.first(capture, photos, least, settings, self._run)
        pace = replace(settings.pace, fade=settings.fade / math.sqrt(len(targets)))
        self._descent = Descent(self._field(begun), pace, self._run)
        stats.given = capture.count

    def advance(self, clock: _Clock) -> Iterator[int]:
        """Take steps, one at least."""
        stats, looks, turns = self._stats, 1, list[int]()
        steps = stats.planned = clock.steps
        while stats.steps < steps or not stats.steps:
            way = stats.steps / steps
            if way * self._settings.looks >= looks:
                self._look(way)
                looks += 1
            if not turns:
                turns = self._rng.permutation(len(self._gains)).tolist()
                stats.rounds.append([])
                steps = max(clock.left(stats.steps), 1) if stats.steps else steps
            stats.rounds[-1].append(self._step(turns.pop(), way))
            stats.steps += 1
            yield stats.steps

    def result(self) -> Gaussians:
        """As they stand."""
        self._drop()
        gaussians, stats = self._descent.field.gaussians(), self._stats
        errors = [self._descent.field.measure(self._exposed(view, 1)) for view in range(len(self._gains))]
        stats.kept, stats.psnr = gaussians.count, tuple(error.psnr for error in errors)
        stats.gains = tuple(self._gains.tolist())
        return replace(gaussians, viewpoints=self._capture.cameras)

    def _step(self, view: int, way: float) -> float:
        """Towards a photo, at a share of the way; its dB before."""
        settings = self._settings
        smaller = settings.smaller(way)
        # Before black and white in turn: a black Gaussian shows nothing before black, but covers what is behind it,
        # and would else fade
        target = self._exposed(view, smaller).before(float(self._stats.steps % 2))
        return self._descent.step(target, way, weight=smaller * smaller, structure=settings.structure).psnr

    def _exposed(self, view: int, smaller: int) -> Target:
        return replace(self._sizes[smaller][view], gain=float(self._gains[view]))

    def _look(self, way: float) -> None:
        """Drop what shows nothing; see how photos were exposed, and add what is wanting."""
        self._drop()
        settings, field = self._settings, self._descent.field
        if way > settings.grown + 1e-9:
            return
        gaussians = field.gaussians()
        wrong = self._seen(gaussians)
        share = settings.start + (1 - settings.start) * min(way / settings.grown, 1)
        lacking = round(self._count * share) - field.count
        if lacking <= 0:
            return
        new = start.further(self._capture, wrong, lacking, settings, self._rng)
        self._descent.add(self._field(new.changed(**joined([gaussians, new]))))

    def _seen(self, gaussians: Gaussians) -> list[NDArray]:
        """Draw every photo once, to see how each was exposed.

        Returns:
            By view, (H, W) |error|, smoothed; 0 where a photo knows nothing.
        """
        draw = Renderer(gaussians, self._threads, **DEFINITION).render
        logs, wrong = list[float](), list[NDArray]()
        for view in range(len(self._gains)):
            target = self._exposed(view, 1)
            picture = draw(target.camera)
            known = np.isfinite(target.photo)
            error = np.where(known, np.float32(target.gain) * picture - target.photo, np.float32(0))
            logs.append(log_gain(picture[known], target.photo[known]))
            wrong.append(start.smoothed(np.abs(error).sum(axis=-1)))
        self._gains = _gains(np.array(logs), self._settings.exposure)
        return wrong

    def _drop(self) -> None:
        keep = self._descent.field.opacities >= self._settings.faded
        if keep.any() and not keep.all():
            self._descent.keep(keep)

    def _field(self, gaussians: Gaussians) -> FreeGaussians:
        return FreeGaussians(gaussians, units(gaussians, self._cameras), self._run, self._settings.functions)

    @property
    def _cameras(self) -> Sequence[Camera]:
        return [target.camera for target in self._sizes[1]]


def _gains(logs: NDArray, certain: float) -> NDArray:
    """(V,) gains of photos by the logarithms of what was measured, their median 1: one that is exposed otherwise makes
    the scene neither darker nor brighter.

    Photos that nobody has seen have gains of their own, near 1. So only what surpasses `certain` is taken from a photo;
    the rest stays in the scene.
    """
    apart = logs - np.median(logs)
    return np.exp(np.sign(apart) * np.maximum(np.abs(apart) - certain, 0))
