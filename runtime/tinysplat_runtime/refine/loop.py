"""The loop: draw a photo, see what is wrong, correct the Gaussians that it sees, go on with the next one; and know how
good the whole is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from ..render import between
from ..render.gradient import Grid, MovableGaussians, PhotoError, Target
from ..render.kernels_blend import TILE_HEIGHT, TILE_WIDTH
from ..render.kernels_gradient import LOG_DEPTH, SH_RED, VALUES
from ..render.near import Shares
from ..system.decibels import decibels
from . import kernels
from .price import PlanePrice
from .schedule import Turn, held_back, order, turn
from .settings import LIMITS, Settings

NEIGHBOURS = 2
"""Views nearest to a photo's, between which and it are the places that it is drawn as if from."""

JUDGED = 8
"""Photos, spread over all, that a state is judged by: what steps cost stays most of the time."""

JUDGED_PIXELS = 256 * 256
"""Of a photo, about, by which a state is judged: tiles spread over larger ones."""

COVERED = 0.4
"""A pixel is covered where no more than this transmittance is left."""


class Loop:
    """Gaussians on their way.

    Attributes:
        field: as they stand.
        exposures: (V, 2) float64, gain and offset of every photo against the scene; the mean of those that correct
            stays 1 and 0, and what is held back has these.
        errors: what the last step saw of every photo, each as Gaussians stood when its turn came.
        settings: see there.
        held: photos that judge and correct nothing.
        judged: which photos a state is judged by: these, or where there are none a few of all.
    """

    def __init__(
        self,
        field: MovableGaussians,
        sizes: Sequence[Sequence[Target]],
        prices: dict[tuple[int, int], PlanePrice],
        settings: Settings,
        run_jobs: Callable,
    ) -> None:
        """Begin.

        Args:
            field: moved.
            sizes: the photos at every size that steps alternate between, the coded one first.
            prices: by layer and view.
            settings: see there.
            run_jobs: maps a function over a list, on any number of threads.
        """
        self.field, self.errors = field, tuple[PhotoError, ...]()
        self._sizes, self._prices, self.settings, self._run = sizes, prices, settings, run_jobs
        self.exposures = np.tile([1.0, 0.0], (len(sizes[0]), 1))
        self._exposure_means = np.zeros((2, *self.exposures.shape))
        self._gradient = np.zeros_like(field.values)
        self._first, self._second = np.zeros((2, *field.values.shape), np.float32)
        self._count, self._corrections = 0, np.zeros(len(sizes[0]), int)  # of every view's Gaussians
        self._edges = {(grid.layer, grid.view): self._edge_weights(grid) for grid in field.grids}
        views = len(sizes[0])
        spread = np.unique(np.linspace(0, views - 1, min(views, JUDGED)).round().astype(int)).tolist()
        self.held = held_back(views, settings.held_back)
        self.judged = self.held or spread
        self._covered: dict[int, Target] = {}
        self._fronts = [self._seen_between(view) for view in range(views)]
        self._drawn = float(np.mean([np.count_nonzero(shares.whole) for fronts in self._fronts for shares in fronts]))

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
        wrong = [grid for grid in self.field.grids if any(_corrects(view, shares[view], grid) for view in views)]
        for grid in wrong:
            self._gradient[:, grid.rows] = 0
        errors = {view: self._draw(view, now, shares[view], len(views)) for view in views}
        self._corrections[list({grid.view for grid in wrong})] += 1
        self._run(self._regularise, wrong)
        self._run(self._correct, wrong)
        for view, error in errors.items():
            self._expose(view, error)
        return errors

    def _draw(self, view: int, now: Turn, shares: Shares, together: int) -> PhotoError:
        """What a photo lacks; what would mend it is added to the gradient, as one of all photos that see a Gaussian."""
        target = self._exposed(view, self._sizes[now.size][view])
        weight = self._drawn / together * self._sizes[0][view].photo.size / target.photo.size
        own = [grid.rows for grid in self.field.grids if grid.view == view and not _corrects(view, shares, grid)]
        spared = [self._gradient[:, rows].copy() for rows in own]
        hidden = self.settings.hidden
        error = self.field.measure(target, shares=shares, gradient=self._gradient, weight=weight, hidden=hidden)
        for rows, before in zip(own, spared, strict=True):
            self._gradient[:, rows] = before
        return error

    def put(self, values: NDArray) -> None:
        """Give the Gaussians these values, (6, rows) float32."""
        self.field.values[:] = values

    def photo_psnr(self) -> float:
        """dB of the photos that are judged, as they are, drawn from all Gaussians, near views first; the mean."""
        targets = [self._sizes[0][view] for view in self.judged]
        errors = [self.field.measure(target, shares=self.field.shares(target.camera)) for target in targets]
        return float(np.mean([error.psnr for error in errors]))

    def check(self) -> float:
        """dB of the photos that judge. Of those held back, as all Gaussians show them, of their mean squared error; of
        others the mean, each as the others' Gaussians show it where those showed something first, but for photos of
        which they showed nothing.
        """
        if self.held:
            targets = [self._exposed(view, self._sizes[0][view]) for view in self.held]
            errors = [self.field.measure(target, shares=self.field.shares(target.camera)) for target in targets]
            return decibels(float(np.mean([error.squared / (3 * error.known) for error in errors])))
        found = [error.psnr for error in map(self._checked, self.judged) if error.known]
        return float(np.mean(found)) if found else 0.0

    def _checked(self, view: int) -> PhotoError:
        """What a photo lacks if drawn from the Gaussians of the others, where they showed something at first."""
        if view in self._covered:
            target = self._exposed(view, self._covered[view])
            return self.field.measure(target, shares=self.field.shares(target.camera, (view,)))
        target = self._sizes[0][view]
        target = replace(target, photo=_in_parts(target.photo, view))
        shown, shares = np.zeros((*target.photo.shape[:2], 4), np.float32), self.field.shares(target.camera, (view,))
        error = self.field.measure(self._exposed(view, target), shares=shares, shown=shown, most_left=COVERED)
        photo = np.where(shown[..., 3:] > COVERED, np.float32(np.nan), target.photo)
        self._covered[view] = replace(target, photo=photo)
        return error

    def _exposed(self, view: int, target: Target) -> Target:
        """A photo of a view as the loop has found that it was exposed."""
        gain, offset = self.exposures[view]
        return replace(target, gain=gain, offset=offset)

    def _seen_between(self, view: int) -> list[Shares]:
        """What is drawn halfway to each of a view's nearest neighbours."""
        cameras = [target.camera for target in self._sizes[0]]
        away = [float(np.linalg.norm(camera.centre - cameras[view].centre)) for camera in cameras]
        others = sorted((other for other in range(len(cameras)) if other != view), key=lambda other: away[other])
        halfway = [between([cameras[view], cameras[other]], 3)[1] for other in others[:NEIGHBOURS]]
        return [self.field.shares(camera) for camera in halfway]

    def _shares(self, view: int, place: int | None) -> Shares:
        """What of each view a photo is drawn with; see `schedule.Turn.place`."""
        if place is None and self.settings.leaves_own_out:
            return self.field.shares(self._sizes[0][view].camera, (view,))
        if place is None:
            return Shares.by_depth(self.field.shares(self._sizes[0][view].camera).whole)
        return self._fronts[view][place % len(self._fronts[view])]

    def _regularise(self, grid: Grid) -> None:
        shape = (VALUES, grid.height, grid.width)
        values, gradient = (array[:, grid.rows].reshape(shape) for array in (self.field.values, self._gradient))
        key, settings = (grid.layer, grid.view), self.settings
        kernels.add_variation(values[LOG_DEPTH], *self._edges[key], settings.variation, gradient[LOG_DEPTH])
        if settings.price > 0:
            self._prices[key].add_gradient(values, gradient)

    def _correct(self, grid: Grid) -> None:
        settings, count = self.settings, float(self._corrections[grid.view])
        values, *others = (
            array[:, grid.rows] for array in (self.field.values, self._gradient, self._first, self._second)
        )
        for kind, size in enumerate(settings.step_sizes(self._count)):
            numbers = (size, settings.momentum, settings.memory, settings.noise, count, *LIMITS[kind])
            kernels.adam(values[kind], *(array[kind] for array in others), numbers)

    def _expose(self, view: int, error: PhotoError) -> None:
        """A step of Adam for a photo's gain and offset, by mean |error|; then the mean of all goes back."""
        settings, means = self.settings, self._exposure_means[:, view]
        slope = np.array([error.by_gain, error.by_offset]) / (3 * error.known)
        betas = settings.momentum, settings.memory
        for mean, beta, power in zip(means, betas, (slope, slope**2), strict=True):
            mean += (1 - beta) * (power - mean)
        first, second = (mean / (1 - beta ** (self._count + 1)) for mean, beta in zip(means, betas, strict=True))
        self.exposures[view] -= settings.exposure * first / (np.sqrt(second) + 1e-3)
        others = [view for view in range(len(self.exposures)) if view not in self.held]
        self.exposures[others] -= self.exposures[others].mean(axis=0) - (1, 0)

    def _edge_weights(self, grid: Grid) -> tuple[NDArray, NDArray]:
        """(H, W) float32 each: how much a change of depth has to be that of the right and of the lower neighbour."""
        colours = self.field.values[SH_RED:, grid.rows].reshape(-1, grid.height, grid.width)
        across, down = np.zeros((2, grid.height, grid.width), np.float32)
        across[:, :-1] = np.exp(-self.settings.edge * C0 * np.abs(np.diff(colours, axis=2)).mean(axis=0))
        down[:-1] = np.exp(-self.settings.edge * C0 * np.abs(np.diff(colours, axis=1)).mean(axis=0))
        return across, down


def _corrects(view: int, shares: Shares, grid: Grid) -> bool:
    """Whether a photo, drawn with these shares, corrects Gaussians of a grid."""
    return shares.whole[grid.view] > 0 and (shares.has_front or grid.view != view)


def _in_parts(photo: NDArray, first: int) -> NDArray:
    """A photo (H, W, 3), NaN but for tiles of about `JUDGED_PIXELS` together, spread over it; `first` moves them."""
    rows, columns = np.arange(photo.shape[0]) // TILE_HEIGHT, np.arange(photo.shape[1]) // TILE_WIDTH
    every = max(photo[..., 0].size // JUDGED_PIXELS, 1)
    is_judged = (rows[:, None] + 2 * columns + first) % every == 0
    return np.where(is_judged[..., None], photo, np.float32(np.nan))
