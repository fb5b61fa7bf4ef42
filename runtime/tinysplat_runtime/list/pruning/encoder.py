"""Prunes Gaussians whose loss costs less than saving their bytes by coarser steps would.

Rounding a scene to its steps makes an error D. Over Q_g bytes fall by 0.1 octave and D grows by 0.95 dB, so that the
last byte saved by coarser steps costs 3.2·D/R of N Gaussians' R bytes; one that costs less than its own bytes' worth,
3.2·D/N, is left out. What is left makes up for what others would cost: for most of it in an object or where Gaussians
are large, for less in a place whose Gaussians are about as large as pixels (`Terms.slope`). Each Gaussian that is left
matters more, so its steps are finer (`Terms.steps`): quality at a Q_g stays the same.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...codec.job import Job
from ...codec.search import Coder
from ...errors import warn
from ...gaussian.gaussians import Gaussians
from ...system import disk
from ...system.evenly import evenly
from ...system.threads import Crew
from ..blocks import blocks_of
from ..coding.encoder import ListEncoder
from ..coding.rounding import MOST_BLOCKS, Rounding
from ..views import TOGETHER, Views, views_of_block
from ..visible import taken, visible
from .removal import Pruned, Remover
from .tiers import tiers_of


@dataclass(frozen=True)
class Terms:
    """How much is pruned, and how the rest is coded.

    Attributes:
        slope: worth of a Gaussian over the mean error per Gaussian of `Rounding.rounded`.
        steps: steps of what is left, over those of Q_g.
    """

    slope: float
    steps: float

    def towards(self, other: Terms, share: float) -> Terms:
        """Terms between these and others, 0 to 1 of the way in octaves."""
        return Terms(self.slope ** (1 - share) * other.slope**share, self.steps ** (1 - share) * other.steps**share)


OBJECT = Terms(slope=6.0, steps=0.5)
"""At equal bytes a slope of 6 shows as much as 12 and more than 1 and 3."""

DENSE_PLACE = Terms(slope=1.5, steps=0.8)
"""At equal bytes a slope of 1.5 shows as much as 0.4 and more than 0.1 and 6."""

SPARSE_PLACE = Terms(slope=12.0, steps=1.0)
"""At equal bytes a slope of 12 shows as much as 25, a little more than 6 and 10 % more than 1.5."""

BYTES_EACH = 4.0
"""Approximate bytes of a Gaussian at Q_g = 0."""

OCTAVES_PER_QP, OCTAVES_PRUNED = 0.1, 0.16
"""By which bytes fall over Q_g, of the same Gaussians and of those that are worth their bytes."""


NEAR_PLACE, NEAR_OBJECT = (0.3, 0.05), (0.08, 0.05)
"""See `Coder.near`: of an object, more of the error is that of what is left out, which finer steps do not give back."""


@dataclass(frozen=True, eq=False)
class _Block:
    """A block of the list.

    Attributes:
        gaussians: (n,).
        remover: ranks them; None without known viewpoints, or after the time limit.
    """

    gaussians: Gaussians
    remover: Remover | None


class PruningEncoder(Coder):
    """Codes a list at any Q_g, without the Gaussians that are not worth their bytes there.

    A large list is ranked block by block, and what a Gaussian is worth is the same in all of them.

    Attributes:
        profile: how planes are coded.
    """

    db_per_qp = 1.2

    def __init__(
        self, job: Job, views: Views, rounding: Rounding, *, seconds: float = math.inf, together: int = TOGETHER
    ) -> None:
        """Look at the Gaussians.

        Args:
            job: a list, and how it is coded; errors as those of `ListEncoder`.
            views: where they are looked at from.
            rounding: how coarsely all of them would be coded.
            seconds: time limit; Gaussians not examined by then are kept.
            together: most Gaussians that are ranked together.
        """
        self.profile, self._job, self._views = job.profile, job, views
        until = time.monotonic() + seconds
        # removers hold it, and would hold the encoder with a method of its
        self._is_late: Callable[[], bool] = lambda: time.monotonic() > until
        self.near = NEAR_OBJECT if views.is_object else NEAR_PLACE
        terms = OBJECT if views.is_object else DENSE_PLACE.towards(SPARSE_PLACE, rounding.steps.sparse)
        self._slope, self._rounding = terms.slope, rounding.times(terms.steps)
        with job.stats.watch.stage("rank"):
            shown = visible(job.gaussians)
            rows = blocks_of(shown.means, together)
            several = len(rows) > 1
            self._blocks = []
            for own in job.told.progress("looking at blocks", rows) if several else rows:
                block = taken(shown, own)
                self._blocks.append(self._block(block, views_of_block(block, views) if several else views))
                disk.let_go()

    def _block(self, gaussians: Gaussians, views: Views) -> _Block:
        remover = None
        if views.deciding and not self._is_late():
            remover = Remover(
                gaussians, views.deciding, Crew(self._job.threads).map, views.judging, self._is_late, self._job.told
            )
        return _Block(gaussians, remover)

    def expect(self, size: float) -> tuple[float, float]:
        """As `Coder.expect` says: what few bytes have room for is fewer Gaussians with coarser steps."""
        each = size / sum(block.gaussians.count for block in self._blocks)
        return math.log2(BYTES_EACH / each) / OCTAVES_PRUNED, OCTAVES_PRUNED

    def code(self, qp: float) -> bytes:
        """The file at Q_g; errors as those of `ListEncoder.code`."""
        return self.settled(qp).code(qp)

    def settled(self, qp: float) -> ListEncoder:
        """What codes the Gaussians that are worth their bytes at Q_g."""
        with self._job.stats.watch.stage("rank"):
            pruned, penalties = self._pruned(qp)
            tiers = tiers_of([(block.remover, own) for block, own in zip(self._blocks, pruned, strict=True)])
        whole = Pruned.joined(pruned)
        self._job.stats.left_out = whole.left_out
        if self._is_late():
            warn("time for pruning was up: more is kept than needs to be")
        kept = whole.gaussians.with_notes(replace(self._job.gaussians.notes, pruned=whole.text))
        ends = np.cumsum([own.rows.size for own in pruned])
        del pruned, whole

        def recolour(decoded: Gaussians, rows: NDArray) -> NDArray:
            sh, numbers = decoded.sh.copy(), np.searchsorted(ends, rows, side="right")
            for number, block in enumerate(self._blocks):
                if block.remover is not None:
                    own = numbers == number
                    sh[own] = block.remover.recoloured(decoded.taken(own), penalties).sh
            return sh

        disk.let_go()
        self._job.told.say("step", "coding")
        # by direction, colours would be fitted to views' errors
        by_errors = None if kept.degree else recolour
        return ListEncoder(replace(self._job, gaussians=kept), self._rounding, tiers=tiers, recolour=by_errors)

    def _pruned(self, qp: float) -> tuple[list[Pruned], list[float]]:
        """What is left of each block at Q_g, and the cost of SH coefficients."""
        ranked = [block for block in self._blocks if block.remover is not None]
        error, count, squares = 0.0, 0, np.zeros(ranked[0].gaussians.sh.shape[1] if ranked else 1)
        for number in evenly(len(ranked), MOST_BLOCKS):
            block = ranked[number]
            rounded = self._rounding.rounded(block.gaussians, qp, self._job.threads)
            error += block.remover.error_of(rounded)  # type: ignore[union-attr]
            count += rounded.count
            squares += np.einsum("nsc,nsc->s", rounded.sh, rounded.sh, dtype=np.float64) / 3
            del rounded
            disk.let_go()
        worth = self._slope * error / max(count, 1)
        slope = worth / BYTES_EACH * 2 ** (OCTAVES_PER_QP * qp)
        penalties = _band_penalties(squares / max(count, 1), slope)
        found: list[Pruned] = []

        def note() -> str:
            return f"{sum(own.left_out for own in found):,} left out"

        several = len(self._blocks) > 1
        for block in self._job.told.progress("blocks", self._blocks, note) if several else self._blocks:
            one = Pruned.none(block.gaussians) if block.remover is None else block.remover.prune(worth, penalties)
            found.append(Pruned.joined([one]))
            del one
            disk.let_go()
        return found, penalties


def _band_penalties(squares: NDArray, slope: float) -> list[float]:
    """What squared SH coefficients of each degree above 0 cost in bits, times the error that a bit is worth.

    A coefficient of a band with the mean square σ², of `squares` (S,) by function, takes x²/(2σ² ln 2) bits more than
    one of 0.
    """
    bands = [squares[start**2 : (start + 1) ** 2].mean() for start in range(1, math.isqrt(len(squares)))]
    return [slope / (16 * math.log(2) * max(float(band), 1e-12)) for band in bands]
