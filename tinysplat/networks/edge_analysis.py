"""What `edge` takes from `sweep`: the analysis at half resolution, and what the photos say of a depth.

Nothing here is learned, and no gradient flows into it.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from .sweep import AlignmentSettings, Comparison, SweepSettings, agreed, align_photos, double, matched, soft_argmin

WINDOW = 2
"""Candidates on each side of the best that the expected depth is taken over."""

ANALYSIS = SweepSettings(candidates=26, alignment=AlignmentSettings(steps=1, any_exposure=True))
"""The analytic part."""

HALF_ALIGNMENT = AlignmentSettings(steps=1, window=7, any_exposure=True)
"""Of depth to the photos at half resolution."""

FINE_COLOUR_WEIGHT = 2.2
"""Of the costs at half resolution, which compare colours alone: fewer values to warp."""

COARSER_GRIDS = 2
"""1/4, 1/8, … of the photo's sides, whose costs lead those of the next finer one."""

LEAD, LEAD_LIMIT = 0.1, 2.0
"""Factor on a coarser grid's aggregated costs, and where these are cut."""

CONTRAST = 8.0
"""Factor on raw costs less their mean over candidates, as an input."""


@dataclass(frozen=True)
class Matches:
    """What matching finds at half resolution of views whose depth is sought; no gradient flows into it.

    Attributes:
        costs: (V, D, h, w) of matching.
        paths: (V, D, h, w) aggregated costs, less their minimum over candidates.
        coarse_paths: (V, D, h / 2, w / 2), the same of the next coarser grid.
        level: (V, 1, h, w) of the lowest of `paths`, a level of `InverseDepths`.
    """

    costs: Tensor
    paths: Tensor
    coarse_paths: Tensor
    level: Tensor


@dataclass(frozen=True)
class Analysis:
    """What the analytic part finds at half resolution; no gradient flows into it.

    Attributes:
        relative_cost: (V, D, h, w) matching costs less their mean over candidates, times `CONTRAST`.
        best_cost: (V, 1, h, w) the lowest cost, times the same.
        paths: (V, D, h, w) aggregated costs, less their minimum over candidates.
        coarse_paths: (V, D, h / 2, w / 2), the same of the next coarser grid.
        level: (V, 1, h, w) filled depth, a level of `InverseDepths`.
        agreement: (V, 1, h, w) of views, before filling.
    """

    relative_cost: Tensor
    best_cost: Tensor
    paths: Tensor
    coarse_paths: Tensor
    level: Tensor
    agreement: Tensor


def match(half: Tensor, views: Comparison) -> Matches:
    """The beginning of `sweep`: matching and aggregation at half resolution.

    A coarser grid's aggregated costs are added, with a small weight, to the costs of the next finer one: large blank or
    repeated things are matched by what surrounds them.

    Args:
        half: (…, 3, h, w) photos of all views at half resolution, [0, 1].
        views: to match at half resolution.
    """
    fine = replace(ANALYSIS, colour_weight=FINE_COLOUR_WEIGHT, contrast_weight=0.0)
    turned, shift = views.terms
    grids = [(half, turned)]
    for _ in range(COARSER_GRIDS):
        grids.append((functional.avg_pool2d(grids[-1][0], 2), functional.avg_pool2d(grids[-1][1], 2)))
    lead = torch.zeros(())
    coarse = lead
    for guide, turned in reversed(grids):
        at_half = guide is half
        cost, paths = matched(guide, replace(views, terms=(turned, shift)), fine if at_half else ANALYSIS, lead)
        if not at_half:
            coarse = paths
            lead = double(LEAD * paths.clamp_max(LEAD_LIMIT))
    return Matches(cost, paths, coarse, soft_argmin(paths))


def analyse(half: Tensor, views: Comparison, matches: Matches, levels: Tensor) -> Analysis:
    """What `sweep` does next: agreement, filling and alignment at half resolution.

    Args:
        half, views: as for `match`.
        matches: of the views whose depth is sought.
        levels: (…, 1, h, w) of the matches of all views.
    """
    level, agreement = agreed(levels, half, views, ANALYSIS)
    level = align_photos(level, half, views, HALF_ALIGNMENT)
    cost = matches.costs
    relative = CONTRAST * (cost - cost.mean(dim=1, keepdim=True))
    best = CONTRAST * cost.amin(dim=1, keepdim=True)
    return Analysis(relative, best, matches.paths, matches.coarse_paths, level, agreement)


def expected_level(logits: Tensor) -> tuple[Tensor, Tensor]:
    """Level (V, 1, h, w) about the most likely candidate, and the probability of that neighbourhood."""
    count = logits.shape[1]
    index = torch.arange(count, dtype=logits.dtype, device=logits.device)[:, None, None]
    best = logits.argmax(dim=1, keepdim=True).to(logits.dtype)
    near = torch.softmax(logits, dim=1) * ((index - best).abs() < WINDOW + 0.5)
    mass = near.sum(dim=1, keepdim=True)
    return (near * index).sum(dim=1, keepdim=True) / mass / (count - 1), mass


def photo_difference(level: Tensor, images: Tensor, views: Comparison) -> tuple[Tensor, Tensor]:
    """What the sources show at each pixel's place less the pixel itself, (V, 3, H, W), mean of those that see it.

    Levels (V, 1, H, W) are those of views whose depth is sought, everything else is of all views. The second result is
    the share of sources that have the place in their frame, (V, 1, H, W).
    """
    pairs = views.pairs
    read, seen, _ = views.read(images, views.depths.of(pairs).at(level))
    total = pairs.by_view((read[:, :, 0] - images[pairs.reference]) * seen).sum(dim=1)
    count = pairs.by_view(seen).sum(dim=1)
    return total / count.clamp_min(1), count / pairs.sources
