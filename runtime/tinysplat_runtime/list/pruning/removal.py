"""Which Gaussians of a scene pictures hardly need: they are left out, and the others' colours make up for them.

What removing a Gaussian does to views about the scene is known exactly (`kernels`). The cheapest go, a few at a time,
as many at once would add up to holes. Then what is left is fitted to the pictures of all Gaussians: SH coefficients by
least squares (`Remover.recoloured`), all else by gradient (`correction`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import FIELDS, Gaussians
from ...gaussian.sh import sh_basis
from ...scene.cameras import Camera
from ...system import disk
from ...system.decibels import decibels
from ...system.told import NOBODY, Told
from . import kernels
from .correction import corrected
from .merging import merged
from .pictures import Pictures

SHARE = 0.2
"""Of the present Gaussians that go before they are ranked again, usually."""

FEW = 0.02
"""Share of the present Gaussians that may go without a look at the others."""

RELAXATION = 1.5
"""Of a fit's step, which counts neighbours as if they moved along."""

HOLD = 0.2
"""Weight of all views that were not looked at, over that of those that were; in these nothing is to change."""

NOTHING_DB = 150.0
"""Of pictures that do not differ."""

_ROWS = 4096


@dataclass(frozen=True, eq=False)
class Pruned:
    """What is left of Gaussians.

    Attributes:
        gaussians: (n,).
        rows: (n,) which they are of those given.
        left_out: how many are not there.
        psnr: dB of their pictures against those of all, from views that chose nothing.
    """

    gaussians: Gaussians
    rows: NDArray
    left_out: int
    psnr: float

    @classmethod
    def none(cls, gaussians: Gaussians) -> Pruned:
        """With all of them left."""
        return cls(gaussians, np.arange(gaussians.count), 0, NOTHING_DB)

    @classmethod
    def joined(cls, blocks: Sequence[Pruned]) -> Pruned:
        """What is left of blocks, one after the other, each of which is seen as much; on disk where it is much."""
        fields = {}
        for name in FIELDS:
            arrays = [getattr(own.gaussians, name) for own in blocks]
            fields[name] = disk.zeros((sum(map(len, arrays)), *arrays[0].shape[1:]))
            np.concatenate(arrays, out=fields[name])
        gaussians = blocks[0].gaussians.changed(**fields)
        starts = np.cumsum([0, *(own.total for own in blocks)])[:-1]
        rows = np.concatenate([start + own.rows for start, own in zip(starts, blocks, strict=True)])
        error = float(np.mean([10 ** (-own.psnr / 10) for own in blocks]))
        return cls(gaussians, rows, sum(own.left_out for own in blocks), decibels(error))

    @property
    def total(self) -> int:
        """Gaussians there were."""
        return self.left_out + self.gaussians.count

    @property
    def text(self) -> str:
        """For people: `91,647 of 152,746 left out: 44.1 dB`."""
        if not self.left_out:
            return ""
        return f"{self.left_out:,} of {self.total:,} left out: {self.psnr:.1f} dB"


class _Seen(NamedTuple):
    """Sums over some views, of n Gaussians.

    Attributes:
        costs: (n,) float64, what removing one of them costs.
        weights: (n, V) float32 and
        lacks: (n, V, 3) float32, see `kernels.solve_colours`; V is 1 where colours are the same from everywhere.
    """

    costs: NDArray
    weights: NDArray
    lacks: NDArray


class Remover:
    """Ranks Gaussians once, as far as anyone asks, and leaves out any number of them.

    A fifth of those present goes, in turn with a look at half of the views, which corrects costs and colours. What a
    Gaussian cost when it went, or one before it if that is more, is its price. So a
    search ranks once.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        cameras: Sequence[Camera],
        run_jobs: Callable,
        judging: Sequence[Camera] = (),
        is_late: Callable[[], bool] = lambda: False,
        told: Told = NOBODY,
        share: float = SHARE,
    ) -> None:
        """Take (N,) Gaussians.

        Args:
            gaussians: each of opacity 1/255 or more.
            cameras: of the views that decide.
            run_jobs: maps a function over a list, on any threads.
            judging: cameras of other views; every third says whether to merge and to correct, the others what the
                result is worth. Without any, those that decide do both.
            is_late: whether time is up: no more is then looked for that could go, nor merged or corrected.
            told: who is told how many are left, round by round.
            share: of the present Gaussians that go before they are ranked again.
        """
        self._all, self._run, self._is_late, self._told = gaussians, run_jobs, is_late, told
        self._share = share
        self._pictures = Pictures(cameras, run_jobs)
        choosing, telling = judging[::3], [one for number, one in enumerate(judging) if number % 3]
        self._judges = self._kept(choosing) if choosing else self._pictures
        self._tellers = self._kept(telling) if telling else self._judges
        every = range(len(cameras))
        self._halves = (every[0::2], every[1::2] or every)
        with told.counting("looking at views", len(cameras)) as another:
            self._costs = np.stack([self._look(gaussians, half, another).costs for half in self._halves], axis=1)
        self._first, self._sh = self._costs.sum(axis=1), disk.zeros(gaussians.sh.shape)
        self._sh[:] = gaussians.sh
        self._present, self._prices = np.arange(len(self._first)), np.full(len(self._first), np.inf)
        self._dearest, self._rounds = 0.0, 0

    @property
    def whole(self) -> Pruned:
        """All Gaussians."""
        return Pruned.none(self._all)

    def error_of(self, gaussians: Gaussians) -> float:
        """Σ of squared errors of the pictures that decide, over views, pixels and colours."""
        return sum(self._pictures.errors(gaussians))

    def costliest(self, rows: NDArray, count: int) -> NDArray:
        """Which of some rows (n,) integer, as numbers (count,) in their order, pictures need most."""
        self._go_down_to(count)
        return np.sort(np.argsort(self._prices[rows], kind="stable")[rows.size - count :])

    def psnr_of(self, gaussians: Gaussians) -> float:
        """dB of the pictures by which it is chosen what is done."""
        return self._judges.psnr(gaussians)

    def recoloured(self, gaussians: Gaussians, penalties: Sequence[float] = ()) -> Gaussians:
        """With colours nearer to what pictures of all ask for; `penalties` as `prune` has them."""
        for half in self._halves:
            sh = self._recoloured(gaussians, self._look(gaussians, half), half, penalties)
            gaussians = replace(gaussians, sh=sh)
        return gaussians

    def worth_at(self, psnr: float) -> float:
        """About the worth up to which Gaussians can be left out for so many dB: their costs' sum is the error."""
        wanted = 10 ** (-psnr / 10) * self._pictures.values
        costs = np.sort(self._first)
        return float(costs[min(int(np.searchsorted(np.cumsum(costs), wanted)), len(costs) - 1)])

    def prune(self, worth: float, penalties: Sequence[float] = ()) -> Pruned:
        """Leave out what costs less than `worth`, a squared error as `error_of` has it.

        Args:
            worth: of a Gaussian.
            penalties: what a unit of squared SH coefficients of degree 1, 2, … costs; none where they may stay.
        """
        for _ in self._told.progress("pruning", self._ranked(worth), lambda: f"{self._present.size:,} are left"):
            pass
        cheap, keep = self._costs.sum(axis=1) < worth, self._prices >= worth
        keep[self._present[cheap]] = cheap.mean() > FEW and self._present.size > 1  # time was up
        if not keep.any():
            keep[self._present[-1]] = True
        return self._without(np.flatnonzero(keep), penalties)

    def _ranked(self, worth: float) -> Iterator[None]:
        """Rank on until hardly any that are left cost less than `worth`, or time is up."""
        while (self._costs.sum(axis=1) < worth).mean() > FEW and self._present.size > 1 and not self._is_late():
            self._go_on()
            yield

    def prune_to(self, count: int) -> Pruned:
        """Leave out all but `count`."""
        self._go_down_to(count)
        return self._without(np.sort(np.argsort(self._prices, kind="stable")[-count:]), ())

    def _go_down_to(self, count: int) -> None:
        """Rank on until no more than these are left."""
        rounds, left = 0, self._present.size
        while left > max(count, 0):
            rounds, left = rounds + 1, left - math.ceil(self._share * left)
        for _ in self._told.progress("ranking", range(rounds)):
            self._go_on()

    def _go_on(self) -> None:
        """Let the cheapest go, and look again."""
        costs = self._costs.sum(axis=1)
        order = np.argsort(costs, kind="stable")
        going = math.ceil(self._share * order.size)
        gone, rest = order[:going], np.sort(order[going:])
        self._prices[self._present[gone]] = np.maximum(costs[gone], self._dearest)
        self._dearest = max(self._dearest, float(costs[gone[-1]]))
        self._present, self._costs = self._present[rest], self._costs[rest]
        left, half = self._all.changed(sh=self._sh).taken(self._present), self._rounds % 2
        seen = self._look(left, self._halves[half])
        self._costs[:, half] = seen.costs
        self._sh[self._present] = self._recoloured(left, seen, self._halves[half], ())
        self._rounds += 1

    def _without(self, rows: NDArray, penalties: Sequence[float]) -> Pruned:
        """Some rows, with the others in them where that helps, and colours that make up for the rest."""
        gone = np.setdiff1d(np.arange(self._prices.size), rows)
        # Of what hardly showed, half is left alone: it may lie hidden behind what it would be merged into.
        shown = gone[np.argsort(self._prices[gone], kind="stable")[gone.size // 2 :]]
        left = self._all.changed(sh=self._sh).taken(rows)
        if shown.size and not self._is_late():
            disk.let_go()  # what looking took
            together = merged(self._all, rows, np.sort(shown))
            disk.let_go()  # what merging took, several times as much as the Gaussians
            left = max(left, self.recoloured(together, penalties), key=self.psnr_of)
            del together
        if shown.size or penalties:
            left = self.recoloured(left, penalties)
        if shown.size and not self._is_late():
            views = self._pictures
            wanted = [views.wanted[number] for number in range(len(views.cameras))]
            left = max(left, corrected(left, views.cameras, wanted, self._run, self._told), key=self.psnr_of)
        return Pruned(left, rows, self._prices.size - rows.size, self._tellers.psnr(left))

    def _kept(self, cameras: Sequence[Camera]) -> Pictures:
        """Views, with the pictures that all Gaussians make there."""
        pictures = Pictures(cameras, self._run)
        pictures.keep(self._all)
        return pictures

    def _look(self, gaussians: Gaussians, views: Sequence[int], another: Callable[[], object] = object) -> _Seen:
        shape = gaussians.opacities.size, len(views) if gaussians.degree else 1
        seen = _Seen(np.zeros(shape[0]), np.zeros(shape, np.float32), np.zeros((*shape, 3), np.float32))
        for number, sums in enumerate(self._pictures.measure(gaussians, views)):
            column = min(number, shape[1] - 1)
            seen.costs[:] += sums[:, kernels.COST]
            seen.weights[:, column] += sums[:, kernels.BOUND]
            seen.lacks[:, column] += sums[:, kernels.LACK : kernels.LACK + 3]
            another()
        return seen

    def _recoloured(
        self, gaussians: Gaussians, seen: _Seen, views: Sequence[int], penalties: Sequence[float]
    ) -> NDArray:
        degree, sh = gaussians.degree, gaussians.sh.copy()
        by_function = np.zeros(sh.shape[1])
        for band, penalty in enumerate(penalties[:degree], start=1):
            by_function[band * band : (band + 1) ** 2] = penalty * len(views) / len(self._pictures.cameras)
        cameras = [self._pictures.cameras[view] for view in views][: seen.weights.shape[1]]
        centres = np.stack([camera.centre for camera in cameras]) - gaussians.origin

        def solve(start: int) -> None:
            part = slice(start, start + _ROWS)
            towards = gaussians.means[part, None].astype(np.float64) - centres
            towards /= np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1e-30)
            kernels.solve_colours(
                sh_basis(towards, degree),
                seen.weights[part].astype(np.float64),
                seen.lacks[part].astype(np.float64),
                by_function,
                HOLD,
                RELAXATION,
                sh[part],
            )

        self._run(solve, range(0, len(sh), _ROWS))
        return sh
