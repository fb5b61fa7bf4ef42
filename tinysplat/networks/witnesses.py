"""How much of its opacity a Gaussian keeps once all other views have had their say.

Two views need each other. Of more, each has its own errors, and what one view puts in front of what the others see
spoils the picture for all: every further photo made a scene worse. Here a Gaussian gives way to surfaces that it hides,
the more the better these are borne out, and of several views that show the same place the ones nearest to the middle
of the cameras go first: photos never lie on each other exactly, and the mean of six is a blur.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .sweep import Comparison, error_in_sources


@dataclass(frozen=True)
class WitnessSettings:
    """`kept_opacity`.

    Attributes:
        consistency: standard deviation of the error across views at which two show the same place, candidates.
        intrusion_from, intrusion_ramp: candidates before another's surface at which a Gaussian is in its way, and over
            which that grows.
        intrusion: weight of the witnesses against a Gaussian beside those for it.
        own: weight of its own view among those for it.
        enough: views that show one place at full opacity.
        rank_width: difference of distance from the cameras' middle, over the mean distance, that decides who goes
            first.
    """

    consistency: float = 1.0
    intrusion_from: float = 0.1
    intrusion_ramp: float = 0.4
    intrusion: float = 1.0
    own: float = 1.0
    enough: float = 3.0
    rank_width: float = 0.1


def kept_opacity(level: Tensor, trust: Tensor, c2w: Tensor, views: Comparison, settings: WitnessSettings) -> Tensor:
    """Factor (V, 1, H, W) in [0, 1] on the opacity of every pixel's Gaussian; 1 everywhere for two views.

    Args:
        level: (V, 1, H, W) of the depths of `views`.
        trust: (V, 1, H, W) in [0, 1], what each pixel is worth as a witness.
        c2w: (V, 4, 4).
        views: every one with every other, on their photos.
        settings: of this function.
    """
    s, pairs = settings, views.pairs
    error, seen, worth = error_in_sources(level, views, trust)
    worth = worth * seen
    same = worth * torch.exp(-0.5 * (error / s.consistency).square())
    hidden = worth * ((error - s.intrusion_from) / s.intrusion_ramp).clamp(0, 1)
    backing = s.own + pairs.by_view(same).sum(dim=1)
    against = s.intrusion * pairs.by_view(hidden).sum(dim=1)
    share = against / (backing + against) * (1 - 1 / pairs.sources)  # a single other view may be the one that errs

    centres = c2w[:, :3, 3]
    distance = torch.sqrt((centres - centres.mean(dim=0)).square().sum(dim=1))
    rank = distance / distance.mean().clamp_min(1e-9)
    lead = torch.sigmoid((rank[pairs.reference] - rank[pairs.source]) / s.rank_width)[:, None, None, None]
    before = pairs.by_view(same * lead).sum(dim=1)
    return (1 - share) * (s.enough - before).clamp(0, 1)
