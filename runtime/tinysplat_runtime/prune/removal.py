"""Which Gaussians of a scene pictures hardly need: they are left out, and the others' colours make up for them.

What removing a Gaussian does to views about the scene is known exactly (`kernels`); those whose error is below a worth
go, the cheapest half of them in each round, ranked again as their neighbours go. Removals of one round would otherwise
add up to holes. Then SH coefficients are fitted anew to the pictures of all Gaussians.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import FIELDS, Gaussians
from ..gaussian.sh import sh_basis
from ..scene.cameras import Camera
from . import kernels
from .pictures import Pictures

ROUNDS = 5
"""Of ranking and removal."""

SHARE = 0.5
"""Of those cheaper than the worth that a round removes."""

CORRECTIONS = 3
"""Fits of colours after the last round; there is one in each before it, too."""

RELAXATION = 1.5
"""Of a fit's step, which counts neighbours as if they moved along."""

HOLD = 0.2
"""Weight of all views that were not looked at, over that of those that were; in these nothing is to change."""

_ROWS = 4096


@dataclass(frozen=True)
class Thinned:
    """What is left of Gaussians.

    Attributes:
        gaussians: (n,).
        left_out: how many are not there.
        psnr: dB of their pictures against those of all, from the views that decided.
    """

    gaussians: Gaussians
    left_out: int
    psnr: float

    @property
    def text(self) -> str:
        """For people: `91,647 of 152,746 left out: 44.1 dB`."""
        if not self.left_out:
            return ""
        return f"{self.left_out:,} of {self.left_out + self.gaussians.count:,} left out: {self.psnr:.1f} dB"


@dataclass(frozen=True)
class _Seen:
    """Sums over all views of the present Gaussians.

    Attributes:
        costs: (n,) what removing one of them costs.
        weights: (n, V) and
        lacks: (n, V, 3) float32, see `kernels.solve_colours`.
        error: of the pictures.
    """

    costs: NDArray
    weights: NDArray
    lacks: NDArray
    error: float


class Remover:
    """Looks at Gaussians once, and thins them as far as is wanted."""

    def __init__(self, gaussians: Gaussians, cameras: Sequence[Camera], run_jobs: Callable) -> None:
        """Take (N,) Gaussians of opacity 1/255 or more; `run_jobs` maps a function over a list, on any threads."""
        self._all, self._run = gaussians, run_jobs
        self._pictures = Pictures(cameras, run_jobs)
        self._first = self._look(gaussians)

    @property
    def whole(self) -> Thinned:
        """All Gaussians."""
        return Thinned(self._all, 0, self.psnr(0.0))

    def error_of(self, gaussians: Gaussians) -> float:
        """Σ of squared errors of pictures, over views, pixels and colours."""
        return sum(error for _, error in self._pictures.measure(gaussians))

    def costs(self, gaussians: Gaussians) -> NDArray:
        """(n,) what removing one of n Gaussians costs."""
        return self._look(gaussians).costs

    def recoloured(self, gaussians: Gaussians, penalties: Sequence[float] = ()) -> Gaussians:
        """With colours nearer to what pictures of all ask for."""
        return self._recoloured(gaussians, self._look(gaussians), penalties)

    def psnr(self, error: float) -> float:
        """dB of such a sum; 150 of none."""
        return -10 * math.log10(max(error / self._pictures.values, 1e-15))

    def worth_at(self, psnr: float) -> float:
        """About the worth up to which Gaussians can be left out for so many dB: their costs' sum is the error."""
        wanted = 10 ** (-psnr / 10) * self._pictures.values
        costs = np.sort(self._first.costs)
        return float(costs[min(int(np.searchsorted(np.cumsum(costs), wanted)), len(costs) - 1)])

    def thin(self, worth: float, penalties: Sequence[float] = ()) -> Thinned:
        """Leave out what costs less than `worth`, a squared error as `error_of` has it.

        Args:
            worth: of a Gaussian.
            penalties: what a unit of squared SH coefficients of degree 1, 2, … costs; none where they may stay.
        """
        gaussians, seen = self._all, self._first
        for number in range(ROUNDS):
            if number:
                seen = self._look(gaussians)
                gaussians = self._recoloured(gaussians, seen, penalties)
            cheap = np.flatnonzero(seen.costs < worth)
            cheapest = cheap[np.argsort(seen.costs[cheap], kind="stable")[: math.ceil(SHARE * len(cheap))]]
            cheapest = cheapest[: seen.costs.size - 1]
            gaussians = taken(gaussians, np.delete(np.arange(seen.costs.size), cheapest))
        return self._corrected(gaussians, penalties)

    def thin_to(self, count: int, penalties: Sequence[float] = ()) -> Thinned:
        """Leave out all but `count`."""
        gaussians, seen = self._all, self._first
        for number in range(ROUNDS):
            if number:
                seen = self._look(gaussians)
                gaussians = self._recoloured(gaussians, seen, penalties)
            kept = count + (self._all.count - count) * (ROUNDS - 1 - number) // ROUNDS
            dearest = np.argsort(seen.costs, kind="stable")[seen.costs.size - kept :]
            gaussians = taken(gaussians, np.sort(dearest))
        return self._corrected(gaussians, penalties)

    def _corrected(self, gaussians: Gaussians, penalties: Sequence[float]) -> Thinned:
        for _ in range(CORRECTIONS):
            gaussians = self._recoloured(gaussians, self._look(gaussians), penalties)
        psnr = self.psnr(self.error_of(gaussians))
        return Thinned(gaussians, self._all.count - gaussians.count, psnr)

    def _look(self, gaussians: Gaussians) -> _Seen:
        shape = gaussians.opacities.size, len(self._pictures.cameras)
        seen = np.zeros(shape[0]), np.empty(shape, np.float32), np.empty((*shape, 3), np.float32)
        total = 0.0
        for number, (sums, error) in enumerate(self._pictures.measure(gaussians)):
            seen[0][:] += sums[:, kernels.COST]
            seen[1][:, number] = sums[:, kernels.BOUND]
            seen[2][:, number] = sums[:, kernels.LACK : kernels.LACK + 3]
            total += error
        return _Seen(*seen, total)

    def _recoloured(self, gaussians: Gaussians, seen: _Seen, penalties: Sequence[float]) -> Gaussians:
        degree, sh = gaussians.degree, gaussians.sh.copy()
        by_function = np.zeros(sh.shape[1])
        for band, penalty in enumerate(penalties[:degree], start=1):
            by_function[band * band : (band + 1) ** 2] = penalty
        centres = np.stack([camera.centre for camera in self._pictures.cameras]) - gaussians.origin

        def solve(start: int) -> None:
            part = slice(start, start + _ROWS)
            towards = gaussians.means[part, None].astype(np.float64) - centres
            towards /= np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1e-30)
            kernels.solve_colours(
                sh_basis(towards, degree), seen.weights[part].astype(np.float64), seen.lacks[part].astype(np.float64),
                by_function, HOLD, RELAXATION, sh[part],
            )  # fmt: skip

        self._run(solve, range(0, len(sh), _ROWS))
        return replace(gaussians, sh=sh)


def taken(gaussians: Gaussians, rows: NDArray) -> Gaussians:
    """Some of (N,) Gaussians, in this order."""
    arrays = {name: getattr(gaussians, name)[rows] for name in FIELDS}
    return Gaussians.unchecked(**arrays, origin=gaussians.origin, notes=gaussians.notes)
