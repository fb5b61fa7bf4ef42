"""What `edge` takes from `sweep`: its settings, the analysis at half resolution, and what the photos say of a depth.

Nothing here is learned, and no gradient flows into it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor
from torch.nn import functional

from .exposure import ExposureSettings
from .narrowing import NarrowingSettings
from .sweep import AlignmentSettings, Comparison, SweepSettings, agreed, align_photos, double, matched, soft_argmin
from .witnesses import WitnessSettings

WINDOW = 2
"""Candidates on each side of the best that the expected depth is taken over."""


@dataclass(frozen=True)
class EdgeSettings:
    """Sizes and bounds.

    Attributes:
        analysis: the analytic part.
        exposure: of the photos, taken out beforehand.
        narrowing: of the range that is swept.
        half_alignment: of depth to the photos at half resolution.
        witnesses: of what opacity is kept beside other views.
        fine_colour_weight: of the costs at half resolution, which compare colours alone: fewer values to warp.
        coarser_grids: 1/4, 1/8, … of the photo's sides, whose costs lead those of the next finer one.
        lead: factor on a coarser grid's aggregated costs.
        lead_limit: those costs are cut here.
        widths: channels at 1/2, 1/4, 1/8 and 1/16 resolution.
        fine: channels that the U-Net hands to each pixel of full resolution.
        head: channels of the head at full resolution.
        refiner: channels of the refiner of costs.
        look: candidates on each side of the depth found whose costs the U-Net sees.
        likelihood: fall of a candidate's input value with its aggregated cost.
        contrast: factor on raw costs less their mean over candidates, as an input.
        prior_width: standard deviation of the analytic depth's prior over candidates, candidates.
        prior_floor: lowest log value of that prior.
        depth_reach: bound on the head's change of depth, candidates.
        colour_reach: bound on the change of colour.
        sharpening_reach: bounds on the changes of the factors of `sharpened`.
        least_footprint: standard deviation in pixels that every surface Gaussian has at least: a surface is closed by
            its own Gaussians, however near one goes.
        log_footprint_reach: bound on the change of the logarithm of what is added to that in quadrature.
        coarse: channels of the coarse layer's head.
        coarse_blurs: sides of the boxes, cells, whose mean colours a coarse Gaussian may turn to.
        coarse_reach: bounds on the changes of the logarithms of the coarse layer's inverse depth and width.
    """

    analysis: SweepSettings = field(
        default_factory=lambda: SweepSettings(candidates=26, alignment=AlignmentSettings(steps=1, any_exposure=True))
    )
    exposure: ExposureSettings = field(default_factory=ExposureSettings)
    narrowing: NarrowingSettings = field(default_factory=NarrowingSettings)
    half_alignment: AlignmentSettings = field(
        default_factory=lambda: AlignmentSettings(steps=1, window=7, any_exposure=True)
    )
    witnesses: WitnessSettings = field(default_factory=WitnessSettings)
    fine_colour_weight: float = 2.2
    coarser_grids: int = 2
    lead: float = 0.1
    lead_limit: float = 2.0
    widths: tuple[int, int, int, int] = (32, 64, 96, 96)
    fine: int = 8
    head: int = 16
    refiner: int = 8
    look: int = 3
    likelihood: float = 3.0
    contrast: float = 8.0
    prior_width: float = 0.7
    prior_floor: float = -8.0
    depth_reach: float = 1.0
    colour_reach: float = 0.15
    sharpening_reach: tuple[float, float] = (1.0, 1.0)
    least_footprint: float = 0.4
    log_footprint_reach: float = 1.2
    coarse: int = 32
    coarse_blurs: tuple[int, int] = (9, 33)
    coarse_reach: tuple[float, float] = (0.5, 0.7)


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
        relative_cost: (V, D, h, w) matching costs less their mean over candidates, times `EdgeSettings.contrast`.
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


def match(half: Tensor, views: Comparison, settings: EdgeSettings) -> Matches:
    """The beginning of `sweep`: matching and aggregation at half resolution.

    A coarser grid's aggregated costs are added, with a small weight, to the costs of the next finer one: large blank or
    repeated things are matched by what surrounds them.

    Args:
        half: (…, 3, h, w) photos of all views at half resolution, [0, 1].
        views: to match at half resolution.
        settings: of the network.
    """
    s = settings.analysis
    fine = replace(s, colour_weight=settings.fine_colour_weight, contrast_weight=0.0)
    turned, shift = views.terms
    grids = [(half, turned)]
    for _ in range(settings.coarser_grids):
        grids.append((functional.avg_pool2d(grids[-1][0], 2), functional.avg_pool2d(grids[-1][1], 2)))
    lead = torch.zeros(())
    coarse = lead
    for guide, turned in reversed(grids):
        at_half = guide is half
        cost, paths = matched(guide, replace(views, terms=(turned, shift)), fine if at_half else s, lead)
        if not at_half:
            coarse = paths
            lead = double(settings.lead * paths.clamp_max(settings.lead_limit))
    return Matches(cost, paths, coarse, soft_argmin(paths, s.sharpness))


def analyse(half: Tensor, views: Comparison, matches: Matches, levels: Tensor, settings: EdgeSettings) -> Analysis:
    """What `sweep` does next: agreement, filling and alignment at half resolution.

    Args:
        half, views, settings: as for `match`.
        matches: of the views whose depth is sought.
        levels: (…, 1, h, w) of the matches of all views.
    """
    level, agreement = agreed(levels, half, views, settings.analysis)
    level = align_photos(level, half, views, settings.half_alignment)
    cost = matches.costs
    relative = settings.contrast * (cost - cost.mean(dim=1, keepdim=True))
    best = settings.contrast * cost.amin(dim=1, keepdim=True)
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
