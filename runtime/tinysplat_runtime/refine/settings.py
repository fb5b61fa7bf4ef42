"""What refinement is told: how far a step goes, and what it may cost. Chosen on dev: docs/lab/refine.md."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..render.kernels_place import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED, VALUES
from ..render.near import FEW


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
        price_of_colour: the same of a bit of colours: what is saved there is detail that people see.
        half_after: steps at one size after which steps go half as far: photos contradict each other, and corrected by
            one after the other, Gaussians would go on moving between what each of them asks for.
        exposure: step size of a photo's gain and offset.
        together: photos that are drawn before Gaussians are corrected by the sum of what they lack.
        structure: share of 1 − SSIM in what a photo lacks, the rest |error|.
        hidden: transmittance before a Gaussian, at its middle, below which a photo does not correct it.
        look_every: steps from one look at the check to the next.
        least_gain: dB by which a look has to be better than the best one, so that steps that gain next to nothing,
            and cost bytes, are not taken.
        slack: by how much the mean squared error of photos that are held back, of values from 0 to 1, may grow by the
            others' corrections.
        slack_alike: likewise, by how much their SSIM may fall.
        least_shown: dB and SSIM of which Gaussians of the other photos have to reach one at the start: photos that they
            show worse are fitted without that new views gain. Of photos that are held back, it is not asked.
        patience: looks that may be no better before the loop ends.
        most_steps: after which it ends in any case.
        usual_steps: taken where neither steps nor seconds are asked for.
        steps_below: of these on smaller copies, at most.
        held_back: one of so many photos, at least two, judges and corrects nothing before the end; 0 for none, where
            photos that correct judge, each from the Gaussians of the others.
        given_back: steps at the end on photos that were held back.
        kept: share of every correction that is kept at the end, 1 for all. Between start and end, Gaussians fit these
            photos less closely, and show new views better. Of a capture, all is kept unless photos that are held back
            became less like what the Gaussians of the others show.
        leaves_own_out: draws a photo every other time as a new view is drawn of a capture, from the Gaussians of the
            others alone, in place of by depth.
        closer: whether photos of twice the size are looked at too, where they are at hand.
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
    price_of_colour: float = 0.005
    half_after: float = 8.0
    exposure: float = 2e-3
    together: int = 1
    structure: float = 0.3
    hidden: float = 0.03
    look_every: int = 2
    least_gain: float = 0.03
    slack: float = 0.0025
    slack_alike: float = 0.08
    least_shown: tuple[float, float] = (18.0, 0.6)
    patience: int = 3
    most_steps: int = 10_000
    usual_steps: int = 12
    steps_below: int = 3
    held_back: int = 0
    given_back: int = 0
    kept: float = 0.5
    leaves_own_out: bool = False
    closer: bool = True

    def step_sizes(self, count: int) -> tuple[float, ...]:
        """(6,) by kind of value, after `count` steps."""
        by_kind = {LOG_DEPTH: self.log_depth, LOG_SIZE: self.log_size, LOGIT: self.logit}
        share = 1 / (1 + (count / self.half_after) ** 2)
        return tuple(share * by_kind.get(kind, self.sh) for kind in range(VALUES))


LIMITS: tuple[tuple[float, float], ...] = ((-0.7, 0.7), (-2.0, 2.0), (-25.0, 14.0), *[(-4.0, 8.0)] * (VALUES - SH_RED))
"""Least and greatest value by kind: half to twice the depth, an eighth to seven times the size, any opacity, and
colours from −0.6 to 2.8. Values that begin outside stay where they are or move inwards."""


FOR_TWO = Settings(
    log_depth=0.0, log_size=3e-2, logit=0.05, sh=4e-3, together=2, structure=0.0, hidden=0.0, half_after=math.inf,
    look_every=2, least_shown=(0.0, 0.0), least_gain=0.015, patience=1, most_steps=4, steps_below=0, kept=1.0,
)  # fmt: skip
"""Two photos say nothing more about depth, and little about what hides what: a few short steps, closely looked at."""

OF_CAPTURE = Settings(
    log_depth=6e-4, log_size=0.04, logit=0.08, sh=4.2e-3, price=0.02, price_of_colour=6e-4, structure=0.2,
    patience=2, usual_steps=8, steps_below=5, held_back=8, given_back=2, kept=0.75, leaves_own_out=True, closer=False,
)  # fmt: skip
"""Most is mended on smaller copies, smoothly, which costs few bytes; pixels of their own then go no far way."""

BELOW_CAPTURE = replace(OF_CAPTURE, log_depth=4e-3, log_size=0.1, logit=0.2, sh=7e-3)
"""The same on smaller copies."""

USUAL_PIXELS = 256 * 256
"""Of a view, for which a capture's steps of depth are: they go as many pixels far in larger ones."""


def settings_for(views: int, pixels: int = USUAL_PIXELS, below: bool = False) -> Settings:
    """What fits that many photos of so many pixels; `below`, smaller copies, and what is too small to have any."""
    if views > FEW:
        settings = BELOW_CAPTURE if below else OF_CAPTURE
        return replace(settings, log_depth=settings.log_depth * math.sqrt(min(USUAL_PIXELS / pixels, 1)))
    return FOR_TWO if views == 2 else Settings()
