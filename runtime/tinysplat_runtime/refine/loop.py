"""The loop: draw every photo, see what is wrong, correct all Gaussians at once, and know which step was the best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from ..render import between
from ..render.gradient import Grid, MovableGaussians, PhotoError, Target
from ..render.kernels_gradient import LOG_DEPTH, SH_RED, VALUES
from ..render.near import Shares
from . import kernels
from .price import PlanePrice
from .schedule import turn
from .settings import LIMITS, Settings

NEIGHBOURS = 2
"""Views nearest to a photo's, between which and it are the places that it is drawn as if from."""

JUDGED = 8
"""Photos, spread over all, that a state is judged by: what steps cost stays most of the time."""

COVERED = 0.4
"""A pixel is covered where no more than this transmittance is left."""


class Loop:
    """Gaussians on their way.

    Attributes:
        field: as they stand.
        exposures: (V, 2) float64, gain and offset of every photo against the scene; their mean stays 1 and 0.
        errors: what the last step saw of every photo before it moved.
        settings: see there.
    """

    def __init__(
        self, field: MovableGaussians, sizes: Sequence[Sequence[Target]], prices: dict[tuple[int, int], PlanePrice],
        settings: Settings, run_jobs: Callable,
    ) -> None:  # fmt: skip
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
        self._count = 0
        self._edges = {(grid.layer, grid.view): self._edge_weights(grid) for grid in field.grids}
        views = len(sizes[0])
        self._judged = np.unique(np.linspace(0, views - 1, min(views, JUDGED)).round().astype(int)).tolist()
        self._fronts = [self._seen_between(view) for view in range(views)]

    def step(self) -> None:
        """Draw all photos at one size and in one way, and correct."""
        now = turn(self._count, len(self._sizes))
        targets = self._sizes[now.size]
        area = self._sizes[0][0].photo.size / targets[0].photo.size
        self._gradient[:] = 0
        self.errors = tuple(self._draw(view, target, area, now.place) for view, target in enumerate(targets))
        self._count += 1
        self._run(self._regularise, self.field.grids)
        self._run(self._correct, range(VALUES))
        self._expose()
        self.field.place()

    def _draw(self, view: int, target: Target, area: float, place: int | None) -> PhotoError:
        """What a photo lacks; what would mend it is added to the gradient.

        Drawn by depth, a photo corrects the Gaussians of the others alone: its own show it from wherever on their rays
        they are.
        """
        shares, own = self._shares(view, place), [grid.rows for grid in self.field.grids if grid.view == view]
        spared = [(rows, self._gradient[:, rows].copy()) for rows in own if not shares.has_front]
        error = self.field.measure(self._exposed(view, target), shares=shares, gradient=self._gradient, weight=area)
        for rows, before in spared:
            self._gradient[:, rows] = before
        return error

    def show(self, values: NDArray) -> None:
        """Put the Gaussians where values (6, rows) say."""
        self.field.values[:] = values
        self.field.place()

    def photo_psnr(self) -> float:
        """dB of the photos that are judged, as they are, drawn from all Gaussians, near views first; the mean."""
        targets = [self._sizes[0][view] for view in self._judged]
        errors = [self.field.measure(target, shares=self.field.shares(target.camera)) for target in targets]
        return float(np.mean([error.psnr for error in errors]))

    def check(self) -> float:
        """dB of the photos that are judged, each drawn from the others' Gaussians where those showed something first.

        The mean; 0 where they showed nothing of any.
        """
        errors = [self._from_others(view, self._exposed(view, target)) for view, target in self._checks.items()]
        known = [error.psnr for error in errors if error.known]
        return float(np.mean(known)) if known else 0.0

    @cached_property
    def _checks(self) -> dict[int, Target]:
        """The photos that are judged, where the Gaussians of the others show something when this is first asked for."""
        return {view: self._covered(view, self._sizes[0][view]) for view in self._judged}

    def _exposed(self, view: int, target: Target) -> Target:
        """A photo of a view as the loop has found that it was exposed."""
        gain, offset = self.exposures[view]
        return replace(target, gain=gain, offset=offset)

    def _from_others(self, view: int, target: Target, left: NDArray | None = None) -> PhotoError:
        """What a photo lacks if drawn from the Gaussians of the others, near views first."""
        return self.field.measure(target, shares=self.field.shares(target.camera, (view,)), left=left)

    def _covered(self, view: int, target: Target) -> Target:
        """A photo, NaN where the Gaussians of the others leave much of what is behind them."""
        left = np.empty(target.photo.shape[:2], np.float32)
        self._from_others(view, target, left=left)
        return replace(target, photo=np.where(left[..., None] > COVERED, np.float32(np.nan), target.photo))

    def _seen_between(self, view: int) -> list[Shares]:
        """What is drawn halfway to each of a view's nearest neighbours."""
        cameras = [target.camera for target in self._sizes[0]]
        away = [float(np.linalg.norm(camera.centre - cameras[view].centre)) for camera in cameras]
        others = sorted((other for other in range(len(cameras)) if other != view), key=lambda other: away[other])
        halfway = [between([cameras[view], cameras[other]], 3)[1] for other in others[:NEIGHBOURS]]
        return [self.field.shares(camera) for camera in halfway]

    def _shares(self, view: int, place: int | None) -> Shares:
        """What of each view a photo is drawn with; see `schedule.Turn.place`."""
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

    def _correct(self, kind: int) -> None:
        settings = self.settings
        numbers = (
            settings.step_sizes[kind], settings.momentum, settings.memory, settings.noise, float(self._count),
            *LIMITS[kind],
        )  # fmt: skip
        kernels.adam(self.field.values[kind], self._gradient[kind], self._first[kind], self._second[kind], numbers)

    def _expose(self) -> None:
        """A step of Adam for gains and offsets, by mean instead of summed |error|; then the mean of all goes back."""
        settings, means = self.settings, self._exposure_means
        slopes = np.array([[error.by_gain, error.by_offset] for error in self.errors])
        slopes /= np.array([[3 * error.known] for error in self.errors])
        for mean, memory, power in zip(means, (settings.momentum, settings.memory), (slopes, slopes**2), strict=True):
            mean += (1 - memory) * (power - mean)
        first, second = (
            mean / (1 - memory**self._count)
            for mean, memory in zip(means, (settings.momentum, settings.memory), strict=True)
        )
        self.exposures -= settings.exposure * first / (np.sqrt(second) + 1e-3)
        self.exposures -= self.exposures.mean(axis=0) - (1, 0)

    def _edge_weights(self, grid: Grid) -> tuple[NDArray, NDArray]:
        """(H, W) float32 each: how much a change of depth has to be that of the right and of the lower neighbour."""
        colours = self.field.values[SH_RED:, grid.rows].reshape(-1, grid.height, grid.width)
        across, down = np.zeros((2, grid.height, grid.width), np.float32)
        across[:, :-1] = np.exp(-self.settings.edge * C0 * np.abs(np.diff(colours, axis=2)).mean(axis=0))
        down[:-1] = np.exp(-self.settings.edge * C0 * np.abs(np.diff(colours, axis=1)).mean(axis=0))
        return across, down
