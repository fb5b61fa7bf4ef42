"""How much of its opacity a Gaussian keeps once all other views have had their say.

Two views need each other. Of more, each has its own errors, and what one view puts in front of what the others see
spoils the picture for all: every further photo made a scene worse. Here a Gaussian gives way to surfaces that it hides,
the more the better these are borne out, and of several views that show the same place the ones nearest to the middle
of the cameras go first: photos never lie on each other exactly, and the mean of six is a blur.
"""

import torch
from torch import Tensor

from .sweep import Comparison, error_in_sources

CONSISTENCY = 1.0
"""Standard deviation of the error across views at which two show the same place, candidates."""

INTRUSION_FROM, INTRUSION_RAMP = 0.1, 0.4
"""Candidates before another's surface at which a Gaussian is in its way, and over which that grows."""

INTRUSION, OWN = 1.0, 1.0
"""Weights of the witnesses against a Gaussian beside those for it, and of its own view among the latter."""

ENOUGH = 3.0
"""Views that show one place at full opacity."""

RANK_WIDTH = 0.1
"""Difference of distance from the cameras' middle, over the mean distance, that decides who goes first."""


def kept_opacity(level: Tensor, trust: Tensor, c2w: Tensor, views: Comparison) -> Tensor:
    """Factor (V, 1, H, W) in [0, 1] on the opacity of every pixel's Gaussian; 1 everywhere for two views.

    Args:
        level: (V, 1, H, W) of the depths of `views`.
        trust: (V, 1, H, W) in [0, 1], what each pixel is worth as a witness.
        c2w: (V, 4, 4).
        views: every one with every other, on their photos.
    """
    pairs = views.pairs
    error, seen, worth = error_in_sources(level, views, trust)
    worth = worth * seen
    same = worth * torch.exp(-0.5 * (error / CONSISTENCY).square())
    hidden = worth * ((error - INTRUSION_FROM) / INTRUSION_RAMP).clamp(0, 1)
    backing = OWN + pairs.by_view(same).sum(dim=1)
    against = INTRUSION * pairs.by_view(hidden).sum(dim=1)
    share = against / (backing + against) * (1 - 1 / pairs.sources)  # a single other view may be the one that errs

    centres = c2w[:, :3, 3]
    distance = torch.sqrt((centres - centres.mean(dim=0)).square().sum(dim=1))
    rank = distance / distance.mean().clamp_min(1e-9)
    lead = torch.sigmoid((rank[pairs.reference] - rank[pairs.source]) / RANK_WIDTH)[:, None, None, None]
    before = pairs.by_view(same * lead).sum(dim=1)
    return (1 - share) * (ENOUGH - before).clamp(0, 1)
