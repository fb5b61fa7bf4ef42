"""The loop: draw a photo, see what is wrong, correct the Gaussians that it sees, go on with the next one; and know how
good the whole is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from ..render import between
from ..render.gradient import Grid, MovableGaussians, PhotoError, Target
from ..render.kernels_place import LOG_DEPTH, SH_RED, VALUES
from ..render.near import Shares
from ..scene.cameras import Camera
from ..system import disk
from ..system.decibels import decibels
from ..system.evenly import evenly
from . import kernels
from .photos import COVERED, in_parts
from .price import PlanePrice
from .schedule import Turn, held_back, order, turn
from .settings import LIMITS, Settings

NEIGHBOURS = 2
"""Views nearest to a photo's, between which and it are the places that it is drawn as if from."""

JUDGED = 8
"""Photos, spread over all, that a state is judged by: what steps cost stays most of the time."""


class Look(NamedTuple):
    """How photos that judge are shown: dB, and SSIM over blocks of pixels."""

    psnr: float
    ssim: float


class Loop:
    """Gaussians on their way.

    Attributes:
        field: as they stand.
        exposures: (V, 2) float64, gain and offset of every photo against the scene; the mean of those that correct
            stays, and what is held back has those that it began with.
        errors: what the last step saw of every photo, each as Gaussians stood when its turn came.
        settings: see there.
        held: photos that judge and correct nothing.
        judged: which photos a state is judged by: these, or where there are none a few of all.
    """

    def __init__(
        self,
        field: MovableGaussians,
        sizes: Sequence[Sequence[Target]],
        prices: dict[Grid, PlanePrice],
        settings: Settings,
        run_jobs: Callable,
        exposures: NDArray | None = None,
    ) -> None:
        """Begin.

        Args:
            field: moved.
            sizes: the photos at every size that steps alternate between, the coded one first.
            prices: by grid.
            settings: see there.
            run_jobs: maps a function over a list, on any number of threads.
            exposures: (V, 2) that photos begin with; without them, all are exposed as the scene is.
        """
        self.field, self.errors = field, tuple[PhotoError, ...]()
        self._sizes, self._prices, self.settings, self._run = sizes, prices, settings, run_jobs
        self._begun = np.tile([1.0, 0.0], (len(sizes[0]), 1)) if exposures is None else exposures
        self.exposures = self._begun.copy()
        self._exposure_means = np.zeros((2, *self.exposures.shape))
        views = len(sizes[0])
        self._first, self._second = (disk.zeros(field.values.shape, views=views) for _ in range(2))
        self._count, self._corrections = 0, np.zeros(views, int)  # of every view's Gaussians
        self._edges = dict[Grid, NDArray]()
        for layer in range(1 + field.grids[-1].layer):
            grids = [grid for grid in field.grids if grid.layer == layer]
            weights = disk.zeros((views, 2, grids[0].height, grids[0].width))
            self._edges |= {
                grid: self._edge_weights(grid, of_view) for grid, of_view in zip(grids, weights, strict=True)
            }
        self.held = held_back(views, settings.held_back)
        self._usual = np.delete(self.exposures, self.held, axis=0).mean(axis=0)
        self.judged = self.held or evenly(views, JUDGED)
        self._covered: dict[int, Target] = {}
        self._between = [self._halfway(view) for view in range(views)]
        fronts = (field.shares(camera) for cameras in self._between for camera in cameras)
        self._drawn = float(np.mean([np.count_nonzero(shares.whole) for shares in fronts]))

    def step(self, views: Collection[int] | None = None) -> None:
        """Draw every photo once, or some, at one size and in one way, and after each, or a few, correct what it sees.

        Gaussians are wrong in the same way in most photos that see them: corrected after each, they are right several
        times as soon as corrected by the sum of all. Without `views`, those that are held back correct nothing.
        """
        now, turns = turn(self._count, len(self._sizes)), order(self._count, len(self._sizes[0]))
        turns = [view for view in turns if (view not in self.held if views is None else view in views)]
        together, errors = self.settings.together, dict[int, PhotoError]()
        for first in range(0, len(turns), together):
            errors |= self._learn(turns[first : first + together], now)
        self.errors = tuple(errors[view] for view in sorted(errors))
        self._count += 1

    def _learn(self, views: Sequence[int], now: Turn) -> dict[int, PhotoError]:
        """What some photos lack, by view, before the Gaussians that they are drawn with are corrected by them.

        Drawn by depth, a photo corrects the Gaussians of the others alone: its own show it from wherever on their rays
        they are.
        """
        shares = {view: self._shares(view, now.place) for view in views}
        grids = {view: [grid for grid in self.field.grids if _corrects(view, shares[view], grid)] for view in views}
        wrong = {grid: grid.zeros() for grid in self.field.grids if any(grid in grids[view] for view in views)}
        errors = {
            view: self._draw(view, now, shares[view], {grid: wrong[grid] for grid in grids[view]}, 1 / len(views))
            for view in views
        }
        self._corrections[list({grid.view for grid in wrong})] += 1
        self._run(lambda found: self._correct(*found), wrong.items())
        for view, error in errors.items():
            self._expose(view, error)
        return errors

    def _draw(self, view: int, now: Turn, shares: Shares, gradients: dict[Grid, NDArray], part: float) -> PhotoError:
        """What a photo lacks; what would mend it is added to gradients, as a part of all photos that see a Gaussian."""
        target = self._exposed(view, self._sizes[now.size][view])
        weight = self._drawn * part * self._sizes[0][view].photo.size / target.photo.size
        hidden, structure = self.settings.hidden, self.settings.structure
        return self.field.measure(
            target, shares=shares, gradients=gradients, weight=weight, hidden=hidden, structure=structure
        )

    def put(self, values: NDArray) -> None:
        """Give the Gaussians these values, (6, rows) float32."""
        self.field.values[:] = values

    def go_back(self, start: NDArray, kept: float) -> None:
        """Keep a share of what lies between values (6, rows) that the Gaussians began with and those that they have."""
        for grid in self.field.grids:
            values, begun = (array[:, grid.rows] for array in (self.field.values, start))
            values += np.float32(1 - kept) * (begun - values)

    def photo_psnr(self) -> float:
        """dB of the photos that are judged, exposed as they began, from all Gaussians, near views first; the mean."""
        targets = [_with(self._sizes[0][view], self._begun[view]) for view in self.judged]
        errors = [self.field.measure(target, shares=self.field.shares(target.camera)) for target in targets]
        return float(np.mean([error.psnr for error in errors]))

    def check(self) -> Look:
        """How the photos that judge are shown. Those held back by all Gaussians, with dB of their mean squared error;
        others by the Gaussians of the others.
        """
        if not self.held:
            return self.check_by_others()
        targets = [self._exposed(view, self._sizes[0][view]) for view in self.held]
        errors = [self.field.measure(target, shares=self.field.shares(target.camera)) for target in targets]
        squared = float(np.mean([error.squared / (3 * error.known) for error in errors]))
        return Look(decibels(squared), _alike(errors))

    def check_by_others(self) -> Look:
        """How the photos that judge are shown by the Gaussians of the others, where those showed something first; the
        mean of their dB.
        """
        errors = [error for error in map(self._checked, self.judged) if error.known]
        return Look(float(np.mean([error.psnr for error in errors])) if errors else 0.0, _alike(errors))

    def _checked(self, view: int) -> PhotoError:
        """What a photo lacks if drawn from the Gaussians of the others, where they showed something at first."""
        if view in self._covered:
            target = self._exposed(view, self._covered[view])
            return self.field.measure(target, shares=self.field.shares(target.camera, (view,)))
        target = self._sizes[0][view]
        target = replace(target, photo=in_parts(target.photo, view))
        shown, shares = np.zeros((*target.photo.shape[:2], 4), np.float32), self.field.shares(target.camera, (view,))
        error = self.field.measure(self._exposed(view, target), shares=shares, shown=shown, most_left=COVERED)
        photo = np.where(shown[..., 3:] > COVERED, np.float32(np.nan), target.photo)
        self._covered[view] = replace(target, photo=photo)
        return error

    def _exposed(self, view: int, target: Target) -> Target:
        """A photo of a view as the loop has found that it was exposed."""
        return _with(target, self.exposures[view])

    def _halfway(self, view: int) -> list[Camera]:
        """From halfway to each of a view's nearest neighbours."""
        cameras = [target.camera for target in self._sizes[0]]
        away = [float(np.linalg.norm(camera.centre - cameras[view].centre)) for camera in cameras]
        others = sorted((other for other in range(len(cameras)) if other != view), key=lambda other: away[other])
        return [between([cameras[view], cameras[other]], 3)[1] for other in others[:NEIGHBOURS]]

    def _shares(self, view: int, place: int | None) -> Shares:
        """What of each view a photo is drawn with; see `schedule.Turn.place`."""
        if place is None and self.settings.leaves_own_out:
            return self.field.shares(self._sizes[0][view].camera, (view,))
        if place is None:
            return Shares.by_depth(self.field.shares(self._sizes[0][view].camera).whole)
        return self.field.shares(self._between[view][place % len(self._between[view])])

    def _correct(self, grid: Grid, gradient: NDArray) -> None:
        """Correct a grid's Gaussians by their gradient (6, rows), once what holds them together is added to it."""
        settings, count, shape = self.settings, float(self._corrections[grid.view]), (VALUES, grid.height, grid.width)
        values, *means = (array[:, grid.rows] for array in (self.field.values, self._first, self._second))
        gradient = gradient[:, : grid.height * grid.width]
        planes, slopes = values.reshape(shape), gradient.reshape(shape)
        kernels.add_variation(planes[LOG_DEPTH], *self._edges[grid], settings.variation, slopes[LOG_DEPTH])
        if settings.price > 0:
            self._prices[grid].add_gradient(planes, slopes)
        for kind, size in enumerate(settings.step_sizes(self._count)):
            numbers = (size, settings.momentum, settings.memory, settings.noise, count, *LIMITS[kind])
            kernels.adam(values[kind], gradient[kind], *(array[kind] for array in means), numbers)

    def _expose(self, view: int, error: PhotoError) -> None:
        """A step of Adam for a photo's gain and offset, by mean |error|; then the mean of all goes back."""
        settings, slope = self.settings, np.array([error.by_gain, error.by_offset]) / (3 * error.known)
        numbers = (settings.exposure, settings.momentum, settings.memory, 1e-3, self._count + 1.0, -np.inf, np.inf)
        kernels.adam(self.exposures[view], slope, *self._exposure_means[:, view], numbers)
        others = [view for view in range(len(self.exposures)) if view not in self.held]
        self.exposures[others] -= self.exposures[others].mean(axis=0) - self._usual

    def _edge_weights(self, grid: Grid, weights: NDArray) -> NDArray:
        """Zeros (2, H, W), filled: how much changes of depth have to be those of the neighbours right and below."""
        colours = self.field.values[SH_RED:, grid.rows].reshape(-1, grid.height, grid.width)
        across, down = weights
        across[:, :-1] = np.exp(-self.settings.edge * C0 * np.abs(np.diff(colours, axis=2)).mean(axis=0))
        down[:-1] = np.exp(-self.settings.edge * C0 * np.abs(np.diff(colours, axis=1)).mean(axis=0))
        return weights


def _with(target: Target, exposure: NDArray) -> Target:
    gain, offset = exposure
    return replace(target, gain=gain, offset=offset)


def _alike(errors: Sequence[PhotoError]) -> float:
    """SSIM of all blocks."""
    alike, compared = (sum(getattr(error, name) for error in errors) for name in ("alike", "compared"))
    return alike / max(compared, 1)


def _corrects(view: int, shares: Shares, grid: Grid) -> bool:
    """Whether a photo, drawn with these shares, corrects Gaussians of a grid."""
    return shares.whole[grid.view] > 0 and (shares.has_front or grid.view != view)
