"""The public door: Gaussians and the scene they were made of, to Gaussians that show it better."""

from __future__ import annotations

import math
import operator
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..render.gradient import MovableGaussians, PhotoError
from ..scene.scenes import Scene
from ..system import disk
from ..system.decibels import decibels
from ..system.told import NOBODY, Told
from .coarse import bring_up, halved, halved_picture, lacking_alike
from .exposed import exposure_of
from .loop import Look, Loop
from .photos import matched, sizes_of
from .price import Coded, plane_prices
from .schedule import steps_below
from .settings import settings_for
from .stats import RefineStats

Made = TypeVar("Made")

MAX_STEPS = 10_000

FIRST = {"step": 4.0, "small step": 1.5}
"""What a first step may be expected to cost, in drawings of all photos."""

MENDED = 0.5
"""Share of its squared error that its own exposure may leave for that to be believed."""


class Refining:
    """Gaussians that are corrected until they show the photos that they were made of.

    Every step draws all photos, one after the other, takes the gradient of what each lacks (L1, and SSIM from three
    photos on, after a gain and an offset a photo) and moves the Gaussians of every layer that it sees along their
    pixels' rays, in size, opacity and colour. Now and then every photo is drawn from the Gaussians of the others: the
    result goes as far towards the step at which that was best as `settings.Settings.kept` says, and is the very
    Gaussians that were given if none was better than the start. Of three photos or more, the first steps are taken on
    smaller copies (`coarse.py`). Of a capture, which has more than six photos, a few are held back and correct nothing
    before the end: the result is the last step, or goes as far towards it where the others show these less alike than
    before, and is what was given if they contradict it.

    Attributes:
        stats: what was done so far.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        scene: Scene,
        coded: Coded,
        run_jobs: Callable,
        *,
        steps: int | None = None,
        seconds: float | None = None,
        stats: RefineStats | None = None,
    ) -> None:
        """Find the photos.

        Args:
            gaussians: per pixel, with cameras, of two views or more.
            scene: the photos, found by their cameras' poses; those of twice the size are used where they are at hand.
            coded: what the result will be coded with: what bits of its planes are worth is counted in its steps.
            run_jobs: maps a function over a list, on any number of threads.
            steps: how many to take at most, without `seconds` as many as are usual: 8 for a capture, else 12; the same
                number gives the same result on any number of threads.
            seconds: for how long from now on, in place of `steps`; no step begins that would end later, as far as can
                be told.
            stats: filled with what was done.

        Raises:
            InputError: photos that do not fit the Gaussians, or a budget out of range.
        """
        self._limit = _limit(steps, seconds, len(gaussians.cameras))
        self._deadline = math.inf if seconds is None else time.perf_counter() + seconds
        self.stats = stats if stats is not None else RefineStats()
        self._start, self._worse, self._least = gaussians, 0, Look(-math.inf, -math.inf)
        self._coded, self._run_jobs = coded, run_jobs
        pixels = gaussians.opacities[0].size
        self._settings = settings_for(len(gaussians.cameras), pixels, below=steps_below(pixels, 1, MAX_STEPS) == 0)
        self._loop: Loop | None = None
        self._smaller: _Smaller | None = None
        self._seconds = dict[str, float]()
        self._sizes = sizes_of(gaussians, matched(gaussians, scene), self._settings.closer)

    def _begin(self, told: Told) -> None:
        """Look at the photos, and find what is wrong with them; `told` is told of each."""
        gaussians, stats = self._start, self.stats
        moving = MovableGaussians(gaussians, self._run_jobs)
        begun = time.perf_counter()
        errors = self._errors(moving, told)
        seconds = time.perf_counter() - begun
        prices = self._prices(gaussians, moving)
        self._loop = Loop(moving, self._sizes, prices, self._settings, self._run_jobs, self._exposures)
        self._begun = _copied(moving)
        self._seconds["judging"] = seconds / len(errors) * len(self._loop.judged)
        stats.before = float(np.mean([errors[view].psnr for view in self._loop.judged]))
        self._look()
        if not self._loop.held and all(map(operator.lt, stats.looks[0][1:], self._settings.least_shown)):
            stats.reason = "photos contradict each other: Gaussians of the others hardly show them"
            self._loop = None
        elif self._loop.held:
            stats.held = len(self._loop.held)
            stats.before = stats.looks[0][1]
            self._by_others = self._loop.check_by_others()

    def _errors(self, moving: MovableGaussians, told: Told) -> list[PhotoError]:
        """What each photo lacks at the start, as it was exposed; keeps exposures and halved pictures."""
        views, (height, width) = len(self._sizes[0]), self._sizes[0][0].photo.shape[:2]
        shown, errors = np.zeros((height, width, 4), np.float32), []
        self._exposures = np.tile([1.0, 0.0], (views, 1))
        self._halved = disk.zeros((views, height // 2, width // 2, 3))
        each = zip(self._sizes[0], self._halved, self._exposures, strict=True)
        for target, half, exposure in told.progress("looking at photos", each, total=views):
            shares = moving.shares(target.camera)
            errors.append(moving.measure(target, shares=shares, shown=shown))
            half[:] = halved_picture(shown[..., :3])
            gain, offset = exposure_of(target.photo, shown[..., :3])
            if gain != 1:
                exposed = moving.measure(replace(target, gain=gain, offset=offset), shares=shares)
                if exposed.squared < MENDED * errors[-1].squared:
                    errors[-1], exposure[:] = exposed, (gain, offset)
        return errors

    def run(self, told: Told = NOBODY) -> Gaussians:
        """Look at the photos, and take the steps.

        Args:
            told: is told of each photo, and of each step.

        Returns:
            Gaussians whose notes say how they were refined, or those given.
        """
        self._begin(told)
        most = self._limit if self._deadline == math.inf else None
        below = self._steps_below(self._limit)
        costs = [1.0] * below + [4.0] * (self._limit - below) if most else None
        for _ in told.progress("refining", self._advance(), self._note, most, costs):
            pass
        return self._result()

    def _advance(self) -> Iterator[int]:
        """Steps up to the limit, or as long as what is then to be done ends before the deadline; ends by itself once
        they do no good.
        """
        loop, stats, settings = self._loop, self.stats, self._settings
        if loop is None:
            return
        limit = min(self._limit, settings.most_steps)
        below = self._steps_below(limit)
        while stats.steps < below and self._has_time("small step"):
            small = self._smaller or self._timed("copy", self._go_down)
            self._timed("small step", small.loop.step)
            stats.steps += 1
            yield stats.steps
        self._go_up()
        if loop.held and stats.steps > stats.looks[-1][0]:
            self._look()
        taken = 0
        while stats.steps < limit and self._worse < settings.patience and self._has_time("step"):
            self._timed("step", loop.step)
            stats.steps, taken = stats.steps + 1, taken + 1
            if taken % settings.look_every == 0:
                self._look()
            yield stats.steps

    def _steps_below(self, limit: int) -> int:
        return steps_below(self._start.opacities[0].size, self._settings.steps_below, limit)

    def _note(self) -> str:
        """How things stand, in few words."""
        loop = self._smaller.loop if self._smaller else self._loop
        errors = loop.errors if loop else ()
        return f"photos {np.mean([error.psnr for error in errors]):.2f} dB" if errors else ""

    def _result(self) -> Gaussians:
        """What is kept of the best step so far, of a capture of the last, with notes that say how they were refined;
        the start where nothing was better, or photos held back contradict it.
        """
        loop, stats, start = self._loop, self.stats, self._start
        if loop is None:
            return start
        self._go_up()
        if stats.looks[-1][0] != stats.steps:
            self._look()
        if stats.kept == 0:
            stats.reason = "no step made photos look better from the Gaussians of the others"
            if loop.held:
                stats.reason = f"photos contradict each other: {stats.held} held back lose by it"
            return start
        if loop.held:
            if loop.check_by_others().ssim < self._by_others.ssim:
                loop.go_back(self._begun, self._settings.kept)
            stats.after = next(dB for step, dB, _ in stats.looks if step == stats.kept)
            for _ in range(self._settings.given_back):
                loop.step(loop.held)
        else:
            loop.put(self._best)
            loop.go_back(self._begun, self._settings.kept)
            stats.after = loop.photo_psnr()
        refined = loop.field.gaussians(start)
        if not loop.held and stats.after <= stats.before:
            stats.kept, stats.reason = 0, "no step made the photos themselves look better"
            return start
        figures = f", {stats.held} held back" if stats.held else f": {stats.before:.1f} to {stats.after:.1f} dB"
        text = f"{stats.kept} steps on {len(start.cameras)} photos{figures}"
        return refined.with_notes(replace(start.notes, refined=text))

    def _look(self) -> None:
        """See whether the present state is to be kept: the best so far, or of a capture the last, unless photos held
        back contradict it. Their own Gaussians began as what shows them best: corrected by other photos, these show
        them a little worse, and far worse where photos contradict each other.
        """
        assert self._loop is not None
        look, settings = self._timed("look", self._loop.check), self._settings
        self.stats.looks.append((self.stats.steps, *look))
        if look.psnr < self._least.psnr or look.ssim < self._least.ssim:
            self._worse += 1
            if self._loop.held:
                self.stats.kept = 0
            return
        if not self._loop.held:
            self._least, self._best = Look(look.psnr + settings.least_gain, look.ssim), self._loop.field.values.copy()
        elif self.stats.steps == 0:
            least = decibels(10 ** (-look.psnr / 10) + settings.slack)
            self._least = Look(least, look.ssim - settings.slack_alike)
        self.stats.kept, self._worse = self.stats.steps, 0

    def _go_down(self) -> _Smaller:
        """To a smaller copy."""
        assert self._loop is not None
        gaussians, run_jobs = halved(self._start), self._run_jobs
        moving = MovableGaussians(gaussians, run_jobs)
        targets = lacking_alike(self._sizes[0], self._halved, moving)
        settings = settings_for(len(gaussians.cameras), self._start.opacities[0].size, below=True)
        loop = Loop(moving, [targets], self._prices(gaussians, moving), settings, run_jobs, self._exposures)
        self._smaller = _Smaller(loop, _copied(moving))
        return self._smaller

    def _go_up(self) -> None:
        """From the smaller copy that there is, if any, to all pixels."""
        loop, small, self._smaller = self._loop, self._smaller, None
        assert loop is not None
        if small is not None:
            bring_up(loop.field, small.loop.field, small.start)
            loop.exposures[:] = small.loop.exposures

    def _prices(self, gaussians: Gaussians, moving: MovableGaussians) -> dict:
        bits = self._settings.price, self._settings.price_of_colour
        return plane_prices(gaussians, moving.grids, self._coded, *bits)

    def _timed(self, what: str, work: Callable[[], Made]) -> Made:
        start = time.perf_counter()
        found = work()
        self._seconds[what] = time.perf_counter() - start
        return found

    def _has_time(self, step: str) -> bool:
        """Whether a step, a look at it and the end may be expected to fit."""
        assert self._loop is not None
        first = FIRST[step] * self._seconds["judging"] * len(self._sizes[0]) / len(self._loop.judged)
        ahead = self._seconds.get(step, first) + self._seconds["look"] + self._seconds["judging"]
        return time.perf_counter() + ahead < self._deadline


@dataclass(frozen=True, eq=False)
class _Smaller:
    """A smaller copy on its way, and its values (6, rows) when it was made."""

    loop: Loop
    start: NDArray


def _copied(moving: MovableGaussians) -> NDArray:
    """The values (6, rows) that they have now, of a capture on disk."""
    values = disk.zeros(moving.values.shape, views=1 + moving.grids[-1].view)
    for grid in moving.grids:
        values[:, grid.rows] = moving.values[:, grid.rows]
    return values


def _limit(steps: int | None, seconds: float | None, views: int) -> int:
    if steps is not None and seconds is not None:
        raise InputError("given with steps, which contradicts it; expected one of them", where="seconds")
    if seconds is not None:
        if not 0 < seconds < 86_400:
            raise InputError(f"{seconds:g} s, expected more than 0 and less than a day", where="seconds")
        return MAX_STEPS
    steps = settings_for(views).usual_steps if steps is None else steps
    if isinstance(steps, bool) or not isinstance(steps, (int, np.integer)) or not 1 <= steps <= MAX_STEPS:
        raise InputError(f"{steps!r}, expected a whole number from 1 to {MAX_STEPS}", where="steps")
    return int(steps)
