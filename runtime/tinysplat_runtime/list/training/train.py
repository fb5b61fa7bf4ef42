"""How a list is made: Gaussians of a capture's pixels, a few for all photos, corrected until they show these.

Every step draws a photo, small at first, as 3DGS defines, takes the gradient of what it lacks, and moves, turns,
scales, fades and colours all Gaussians by Adam. Now and then Gaussians that show nothing go, and pixels where photos
still lack something give new ones; later those go that photos hardly need, while the others can still make up for them.
Where masks leave an object alone, what floats beside it, in few photos' pictures, goes all along.
Photos may differ in exposure: each has a gain per colour. Cameras may be off by a pixel or two: of more than a few
photos each is corrected. Nothing is learnt from what moved between these.
Needs numba (`tinysplat[fast]`).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...gaussian.gaussians import Gaussians, joined
from ...render import DEFINITION, Renderer
from ...render.gradient import Target
from ...render.prepare import ALPHA_MIN
from ...scene.cameras import Camera
from ...scene.viewpoints import viewpoint_of
from ...system import disk
from ...system.progress import running
from ...system.threads import Crew, available_cores
from ...system.told import NOBODY, Told
from ..pruning.kernels import COST
from ..pruning.pictures import Pictures
from . import BYTES_EACH, DEFAULT_SECONDS, FEW_PHOTOS, KEPT, start, usual_steps
from .contradicted import contradicted, pixels
from .contrast import smoothed
from .descent import Descent, units
from .exposed import log_gain
from .free import FreeGaussians
from .kept import pixels_of
from .photos import halved
from .places import Places
from .settings import Budget, Settings

COSTS = {4: 1.0, 2: 1.5, 1: 2.0}
"""Of steps on photos so many times smaller, against each other."""

PLANNED_AGAIN = 24
"""Steps after which, at the latest, it is seen how many more there will be."""

FEWER, COVERED = 0.5, 0.9
"""Of the photos that the median Gaussian is in, the share below which few have one in their pictures; and opacity from
which on others cover a pixel."""


@dataclass
class TrainStats:
    """What was done.

    Attributes:
        given, asked, kept: Gaussians of the capture, how many there may be for its detail, and at the end.
        floating: how many were left out because they float beside an object that masks leave alone.
        steps, planned: how many were taken, and how many there would have been with more seconds.
        rounds: dB of the photos of every round, as each was just before its step, at the size that it then had.
        contradicted: share of each photo that the others contradict; empty of few photos.
        psnr: dB of each photo at the end, as it was exposed.
    """

    given: int = 0
    asked: int = 0
    kept: int = 0
    floating: int = 0
    steps: int = 0
    planned: int = 0
    rounds: list[list[float]] = field(default_factory=list)
    contradicted: tuple[float, ...] = ()
    psnr: tuple[float, ...] = ()

    def note(self) -> str:
        """How things stand, in few words."""
        seen = next((one for one in reversed(self.rounds) if one), None)
        return f"photos {np.nanmean(seen):.2f} dB" if seen else ""

    @property
    def plan(self) -> str:
        """What is likely to come of it, in a line."""
        return f"up to {self.asked:,} Gaussians for what the photos show"

    @property
    def is_cut_short(self) -> bool:
        """Whether seconds ended it, not steps."""
        return self.steps < self.planned

    @property
    def text(self) -> str:
        """In a line."""
        found = f"{self.given:,} Gaussians made {self.kept:,} in {self.steps} steps"
        bound = f" of {self.planned}, as there were no more seconds" if self.is_cut_short else ""
        floating = f", without {self.floating:,} floaters" if self.floating else ""
        return f"{found}{bound}: {np.mean(self.psnr):.1f} dB at the pictures they were corrected by{floating}"


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
        InputError: a list, Gaussians of one view, or other photos.
    """
    if len(capture.cameras) < 2 or len(targets) != len(capture.cameras):
        found = f"{len(capture.cameras)} views and {len(targets)} photos, expected per-pixel Gaussians of two or more"
        raise InputError(f"{found} and as many photos", where="capture")
    budget = budget or Budget()
    begun, stats, settings = running(), TrainStats() if stats is None else stats, settings or Settings()
    training = _Training(capture, targets, budget, threads, settings, stats)
    told.say("notice", stats.plan)
    clock = _Clock(budget.steps or training.usual_steps, budget.seconds or DEFAULT_SECONDS, begun)
    costs = [COSTS[settings.smaller(step / clock.steps)] for step in range(clock.steps)]
    for _ in told.progress("training", training.advance(clock), stats.note, clock.steps, costs):
        pass
    return training.result()


@dataclass
class _Clock:
    """Steps, and seconds from now on that bound them, without those in which kernels compile: a first run is to make
    what a second makes.
    """

    steps: int
    seconds: float
    begun: float

    def left(self, done: int) -> int:
        """How many steps there will have been, if seconds go on passing as they did."""
        taken = running() - self.begun
        return done if taken >= self.seconds else min(self.steps, math.ceil(done * self.seconds / taken))


class _Training:
    """Gaussians on their way, and the photos that they are to show.

    Attributes:
        usual_steps: how many are usual for these photos.
    """

    def __init__(
        self,
        capture: Gaussians,
        targets: Sequence[Target],
        budget: Budget,
        threads: int | None,
        settings: Settings,
        stats: TrainStats,
    ) -> None:
        self._capture, self._stats = capture, stats
        self._threads, self._run = threads, Crew(threads or available_cores()).map
        halves = halved(targets)
        self._sizes = {4: halved(halves), 2: halves, 1: list(targets)}
        self._gains, self._contradicted = np.ones((len(targets), 3)), list[NDArray]()
        self._rng = np.random.default_rng(0)
        surface = start.Surface.of(capture, [target.photo for target in targets], settings, self._run)
        fitting = max(round(budget.size / (KEPT * BYTES_EACH)), 1) if budget.size else surface.needed
        self._count = stats.asked = min(surface.needed, budget.gaussians or surface.needed, fitting)
        self.usual_steps = usual_steps(len(targets), surface.texture)
        self._absent = float(np.clip(surface.alone - settings.alone, 0, settings.most_absent))
        self._settings = settings = settings.suited(len(targets), surface.crowded)
        begun = surface.first(max(1, round(settings.start * self._count)), settings)
        pace = replace(settings.pace, fade=settings.fade / math.sqrt(len(targets)))
        self._descent = Descent(self._field(begun), pace, self._run)
        cameras = [target.camera for target in targets]
        self._places = Places(cameras, capture.origin + begun.means, settings) if len(cameras) > FEW_PHOTOS else None
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
            if stats.steps and (not turns or stats.steps % PLANNED_AGAIN == 0):
                steps = clock.left(stats.steps)
            if not turns:
                turns = self._rng.permutation(len(self._gains)).tolist()
                stats.rounds.append([])
            stats.rounds[-1].append(self._step(turns.pop(), way))
            stats.steps += 1
            yield stats.steps

    def result(self) -> Gaussians:
        """As they stood on the mean in the last steps."""
        self._descent.settle()
        if self._places:
            self._places.settle()
        self._drop()
        gaussians, stats = self._descent.field.gaussians(), self._stats
        errors = [self._descent.field.measure(self._exposed(view, 1)) for view in range(len(self._gains))]
        stats.kept, stats.psnr = gaussians.count, tuple(error.psnr for error in errors)
        placed = self._places.viewpoints() if self._places else self._cameras
        seen = (replace(viewpoint_of(camera), gain=gain) for camera, gain in zip(placed, self._gains, strict=True))
        return replace(gaussians, viewpoints=tuple(seen))

    def _step(self, view: int, way: float) -> float:
        """Towards a photo, at a share of the way; its dB before."""
        settings = self._settings
        smaller = settings.smaller(way)
        # Before black and white in turn: a black Gaussian shows nothing before black, but covers what is behind it,
        # and would else fade
        target = self._trusted(view, smaller).before(float(self._stats.steps % 2))
        share = self._absent * way
        absent = self._rng.random(self._descent.field.count) < share if share else None
        descent, weight = self._descent, smaller * smaller
        error = descent.step(target, way, weight=weight, structure=settings.structure, absent=absent)
        if self._places and way >= settings.placed:
            self._places.correct(view, *descent.field.pulled(descent.gradient), way)
        return error.psnr

    def _trusted(self, view: int, smaller: int) -> Target:
        """`_exposed` without what other photos contradict."""
        target = self._exposed(view, smaller)
        if not self._contradicted or not self._contradicted[view].any():
            return target
        out = pixels(self._contradicted[view], target.photo.shape, smaller)
        return replace(target, photo=np.where(out[..., None], np.float32(np.nan), target.photo))

    def _exposed(self, view: int, smaller: int) -> Target:
        """A photo as it would be with the scene's exposure, and its camera where it stands."""
        target = replace(self._sizes[smaller][view], camera=self._camera(view, smaller))
        if (self._gains[view] == 1).all():
            return target
        return replace(target, photo=target.photo / self._gains[view].astype(np.float32))

    def _camera(self, view: int, smaller: int) -> Camera:
        given = self._sizes[smaller][view].camera
        return self._places.seen(view, given) if self._places else given

    def _look(self, way: float) -> None:
        """Drop what shows nothing; see how photos were exposed, what they contradict, and add what is wanting."""
        self._drop()
        if any(target.nothing is not None for target in self._sizes[1]):
            self._clear()
        settings, field = self._settings, self._descent.field
        if way > settings.grown + 1e-9:
            self._spare()
            return
        gaussians = field.gaussians()
        wrong = self._seen(gaussians)
        if way >= settings.agreed and len(wrong) > FEW_PHOTOS:
            self._contradicted = contradicted(wrong, settings.contradicted)
            self._stats.contradicted = tuple(float(blocks.mean()) for blocks in self._contradicted)
            for own, blocks in zip(wrong, self._contradicted, strict=True):
                own[pixels(blocks, own.shape)] = 0
        share = settings.start + (1 - settings.start) * min(way / settings.grown, 1)
        lacking = round(self._count * share) - field.count
        if lacking <= 0:
            return
        new = start.further(self._capture, wrong, lacking, settings, self._rng)
        self._descent.add(self._field(new.changed(**joined([gaussians, new]))))

    def _clear(self) -> None:
        """Drop floaters: what few photos have in their pictures, and others cover in each of these.

        Photos of an object that masks leave alone look at the same place. What few of them have before or behind the
        object corrects these few, and stands about in pictures from elsewhere.
        """
        gaussians = self._descent.field.gaussians()
        cameras = [self._camera(view, 2) for view in range(len(self._gains))]
        places = [pixels_of(gaussians.means, gaussians.origin, camera) for camera in cameras]
        count = np.sum([inside for *_, inside in places], axis=0)
        few = (count > 0) & (count < FEWER * np.median(count))
        if not few.any():
            return
        draw = Renderer(gaussians.taken(~few), self._threads, **DEFINITION).render
        for camera, (row, column, _, inside) in zip(cameras, places, strict=True):
            own = np.flatnonzero(few & inside)
            if own.size:
                few[own] = draw(camera, outputs=("alpha",))["alpha"][row[own], column[own]] >= COVERED
        self._stats.floating += int(few.sum())
        self._descent.keep(~few)

    def _seen(self, gaussians: Gaussians) -> NDArray:
        """Draw every photo once, to see how each was exposed.

        Returns:
            (V, H, W) float32 |error|, smoothed; 0 where a photo knows nothing.
        """
        draw = Renderer(gaussians, self._threads, **DEFINITION).render
        camera, logs = self._cameras[0], list[list[float]]()
        wrong = disk.zeros((len(self._gains), camera.height, camera.width))
        for view, target in enumerate(self._sizes[1]):
            exposed = self._exposed(view, 1)
            picture, known = draw(exposed.camera), np.isfinite(target.photo[..., 0])
            shown, photo = picture[known], target.photo[known]
            logs.append([log_gain(shown[:, colour], photo[:, colour]) for colour in range(3)])
            error = np.where(known[..., None], picture - exposed.photo, np.float32(0))
            wrong[view] = smoothed(np.abs(error).sum(axis=-1))
        # The median of each colour is 1: a photo that is exposed otherwise makes the scene neither darker nor brighter
        self._gains = np.exp(logs - np.median(logs, axis=0))
        return wrong

    def _spare(self) -> None:
        """Drop what photos hardly need; drawn at half their size, which tells it as well."""
        gaussians, settings = self._descent.field.gaussians(), self._settings
        shown = gaussians.opacities >= ALPHA_MIN
        pictures = Pictures([self._camera(view, 2) for view in range(len(self._gains))], self._run)
        costs = np.zeros(gaussians.count)
        for sums in pictures.measure(gaussians.taken(shown), range(len(pictures.cameras))):
            costs[shown] += sums[:, COST]
        lacking = 10 ** (-np.nanmean(np.concatenate(self._stats.rounds[-2:])) / 10) * pictures.values
        worth = settings.worth * lacking / gaussians.count  # NaN where masks left all photos of these rounds out
        keep = costs >= np.fmin(worth, np.quantile(costs, settings.spared))
        self._descent.keep(keep)

    def _drop(self) -> None:
        keep = self._descent.field.opacities >= self._settings.faded
        if keep.any() and not keep.all():
            self._descent.keep(keep)

    def _field(self, gaussians: Gaussians) -> FreeGaussians:
        return FreeGaussians(gaussians, units(gaussians, self._cameras), self._run, self._settings.functions)

    @property
    def _cameras(self) -> Sequence[Camera]:
        return [target.camera for target in self._sizes[1]]
