"""What a Gaussian is worth at a Q_g: as much error as the quantiser's steps bear for the bytes that it takes.

Rounding a scene to its steps makes an error D. Over Q_g bytes fall by 0.1 octave and D grows by 0.95 dB, so that the
last byte saved by coarser steps costs 3.2·D/R of N Gaussians' R bytes; one that costs less than its own bytes' worth,
3.2·D/N, is left out. What is left makes up for what others would cost: for most of it in an object or where Gaussians
are large, for less in a place whose Gaussians are about as large as pixels (`Terms.slope`). Each Gaussian that is left
matters more, so its steps are finer (`Terms.steps`): quality at a Q_g stays the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..codec.job import EncodeStats
from ..codec.list.encoder import ListEncoder
from ..codec.list.views import Views
from ..codec.list.visible import visible
from ..codec.profiles import Profile
from ..codec.search import Coder
from ..gaussian.gaussians import Gaussians
from ..system.threads import Crew
from .removal import Remover, Thinned
from .tiers import tiers_of


@dataclass(frozen=True)
class Terms:
    """How much goes, and how what is left is coded.

    Attributes:
        slope: worth of a Gaussian over the mean error by Gaussian that `ListEncoder.rounded` estimates.
        steps: of what is left, over those of Q_g.
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
"""That a Gaussian takes at Q_g = 0, about."""

OCTAVES_PER_QP = 0.1


class ThinningEncoder(Coder):
    """Codes one set of Gaussians at any Q_g without those that are not worth their bytes at it.

    Attributes:
        profile: how planes are coded.
    """

    def __init__(
        self, gaussians: Gaussians, views: Views, profile: Profile, *, threads: int, stats: EncodeStats
    ) -> None:
        """`views` are where it is looked at from; other arguments and errors as those of `ListEncoder`."""
        self.profile, self._threads, self._stats = profile, threads, stats
        self._views = views
        self._whole = ListEncoder(gaussians, profile, threads=threads, stats=stats, views=views)
        self._terms = OBJECT if views.is_object else DENSE_PLACE.towards(SPARSE_PLACE, self._whole.steps.sparse)
        self._notes = gaussians.notes
        with stats.watch.stage("rank"):
            self._remover = Remover(visible(gaussians), views.deciding, Crew(threads).map, views.judging)

    def code(self, qp: float) -> bytes:
        """The file at Q_g; errors as those of `ListEncoder.code`."""
        with self._stats.watch.stage("rank"):
            thinned, penalties = self.thinned(qp)
            tiers = tiers_of(self._remover, thinned)
        self._stats.left_out, self._stats.left_out_psnr = thinned.left_out, thinned.psnr
        kept = thinned.gaussians.with_notes(replace(self._notes, pruned=thinned.text))

        def recolour(decoded: Gaussians) -> NDArray:
            return self._remover.recoloured(decoded, penalties).sh

        coder = ListEncoder(
            kept,
            self.profile,
            threads=self._threads,
            stats=self._stats,
            views=self._views,
            steps=self._whole.steps,
            tiers=tiers,
            recolour=None if kept.degree else recolour,  # by direction, colours would be fitted to views' errors
        )
        return coder.code(qp, self._terms.steps)

    def thinned(self, qp: float) -> tuple[Thinned, list[float]]:
        """What is left at Q_g, and what its SH coefficients cost."""
        rounded = self._whole.rounded(qp, self._terms.steps)
        worth = self._terms.slope * self._remover.error_of(rounded) / rounded.count
        slope = worth / BYTES_EACH * 2 ** (OCTAVES_PER_QP * qp)
        penalties = band_penalties(rounded, slope)
        return self._remover.thin(worth, penalties), penalties


def band_penalties(gaussians: Gaussians, slope: float) -> list[float]:
    """What squared SH coefficients of each degree above 0 cost in bits, times the error that a bit is worth.

    A coefficient of a band with the mean square σ² takes x²/(2σ² ln 2) bits more than one of 0.
    """
    squares = np.square(gaussians.sh.astype(np.float64)).mean(axis=(0, 2))
    bands = [squares[degree**2 : (degree + 1) ** 2].mean() for degree in range(1, gaussians.degree + 1)]
    return [slope / (16 * math.log(2) * max(float(band), 1e-12)) for band in bands]
