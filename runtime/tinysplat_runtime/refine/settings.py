"""What refinement is told: how far a step goes, and what it may cost. Chosen on dev: docs/lab/refine.md."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..render.kernels_gradient import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED, VALUES

STEPS = 12
"""Taken where neither steps nor seconds are asked for."""


@dataclass(frozen=True)
class Settings:
    """How Gaussians are corrected.

    Attributes:
        log_depth, log_size, logit, sh: largest change of a value in a step, roughly (Adam's step size).
        momentum, memory: Adam's β₁ and β₂.
        noise: Adam's ε: gradients much smaller than this, in |error| summed over a photo's pixels, change little, and
            so cost no bytes.
        variation: weight of the total variation of changes of log depth, at 0 contrast.
        edge: how fast that weight falls with the photo's contrast, e^(−edge · |difference|).
        price: |error| that a bit of the file is worth.
        half_after: steps at one size after which steps go half as far: photos contradict each other, and corrected by
            one after the other, Gaussians would go on moving between what each of them asks for.
        exposure: step size of a photo's gain and offset.
        together: photos that are drawn before Gaussians are corrected by the sum of what they lack.
        hidden: transmittance before a Gaussian, at its middle, below which a photo does not correct it.
        look_every: steps from one look at the check to the next.
        least_gain: dB by which a look has to be better than the best one, so that steps that gain next to nothing,
            and cost bytes, are not taken.
        patience: looks that may be no better before the loop ends.
        most_steps: after which it ends in any case.
    """

    log_depth: float = 2e-3
    log_size: float = 0.1
    logit: float = 0.2
    sh: float = 1.4e-2
    momentum: float = 0.8
    memory: float = 0.99
    noise: float = 2e-3
    variation: float = 0.05
    edge: float = 10.0
    price: float = 0.005
    half_after: float = 8.0
    exposure: float = 2e-3
    together: int = 1
    hidden: float = 0.03
    look_every: int = 2
    least_gain: float = 0.03
    patience: int = 3
    most_steps: int = 10_000

    def step_sizes(self, count: int) -> tuple[float, ...]:
        """(6,) by kind of value, after `count` steps."""
        by_kind = {LOG_DEPTH: self.log_depth, LOG_SIZE: self.log_size, LOGIT: self.logit}
        share = 1 / (1 + (count / self.half_after) ** 2)
        return tuple(share * by_kind.get(kind, self.sh) for kind in range(VALUES))


LIMITS: tuple[tuple[float, float], ...] = (
    (-0.7, 0.7), (-2.0, 2.0), (-25.0, 14.0), *[(-4.0, 8.0)] * (VALUES - SH_RED),
)  # fmt: skip
"""Least and greatest value by kind: half to twice the depth, an eighth to seven times the size, any opacity, and
colours from −0.6 to 2.8. Values that begin outside stay where they are or move inwards."""


FOR_TWO = Settings(
    log_depth=0.0, log_size=3e-2, logit=0.05, sh=4e-3, together=2, hidden=0.0, half_after=math.inf, look_every=2,
    least_gain=0.015, patience=1, most_steps=4,
)  # fmt: skip
"""Two photos say nothing more about depth, and little about what hides what: a few short steps, closely looked at."""


def settings_for(views: int) -> Settings:
    """What fits that many photos."""
    return FOR_TWO if views == 2 else Settings()
