"""`edge`: a small learned network that starts from `sweep` and corrects it.

A look at a coarse grid leaves out depths that the scene does not have (`narrowing`). The analytic part is `sweep`'s:
matching costs, semi-global aggregation, filling, agreement between views, and Gaussians by construction; its costs are
led by those of two coarser grids. A refiner whose weights are the same for every
candidate adds to the logits over inverse depth at quarter resolution: it can learn what a good match looks like, and
no liking for a depth. A U-Net at half resolution sees the costs about the depth that was found; a learned convex
upsampling keeps depth edges sharp; a head at full resolution changes depth, opacity, footprint and colour within
bounds, and a small one the coarse layer. The last layer of every head starts at zero, so that the untrained network is
the analysis and training can only move it from there.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from .aggregation import box_mean, local_contrast
from .edge_analysis import Analysis, EdgeSettings, Matches, analyse, expected_level, match, photo_difference
from .edge_layers import CostRefiner, FeatureUNet, bilinear_logits, convex_upsampling, convolution, zero
from .exposure import one_exposure
from .narrowing import narrowed
from .pairs import ViewPairs
from .surfels import CoarseChanges, coarse_layer, pixel_layer, sharpened, splat_weights
from .sweep import (
    MAX_VIEWS,
    MIN_VIEWS,
    OUTPUT_NAMES,
    Comparison,
    InverseDepths,
    align_photos,
    double,
    error_in_sources,
    opacities_from_agreement,
)
from .witnesses import kept_opacity

__all__ = ["MAX_VIEWS", "MIN_SIDE", "MIN_VIEWS", "OUTPUT_NAMES", "STRIDE", "Edge", "EdgeSettings"]

STRIDE = 16
"""Image sides are multiples of it: the U-Net's coarsest grid."""

MIN_SIDE = 32

OPACITY_CAP = 31 / 32
"""Bound on a surface Gaussian's opacity: nearly none, as where depth is sure what lies behind should not show."""


@dataclass(frozen=True)
class MatchedViews:
    """Photos and cameras: all views, of which some have their depth sought.

    Attributes:
        images: (…, 3, H, W) of all views, as if all were taken with one exposure, to match with.
        shown: (V, 3, H, W) of those whose depth is sought, to take colours from.
        K, c2w: of all views, as `Edge.forward` has them.
        far: (V,) of those whose depth is sought.
        depths: the narrowed ranges of all views.
    """

    images: Tensor
    shown: Tensor
    K: Tensor
    c2w: Tensor
    far: Tensor
    depths: InverseDepths

    def on(self, maps: Tensor, pairs: ViewPairs) -> Comparison:
        """Pairs of the views on the grid of maps."""
        return Comparison.on(maps, self.K, pairs, self.depths)


@dataclass(frozen=True)
class Estimate:
    """Depth at half resolution, by what the views' matches say.

    Attributes:
        logits: (V, D, h, w) over candidates.
        level: (V, 1, h, w).
        agreement: (V, 1, h, w) of the analysis.
        features, coarse_features: of the U-Net, (V, C, h, w) and (V, C', h / 2, w / 2).
        full: (V, 1, 2h, 2w) the level upsampled.
        clues: (V, 2, h, w) confidence, and how far the level lies from that of the analysis.
    """

    logits: Tensor
    level: Tensor
    agreement: Tensor
    features: Tensor
    coarse_features: Tensor
    full: Tensor
    clues: Tensor


@dataclass(frozen=True)
class Surfaces:
    """What the heads start from: surfaces found, and what tells how well.

    Attributes:
        images: (V, 3, H, W), to take colours from.
        logits: (V, D, h, w) over candidates, half resolution.
        features: (V, C, h, w) of the U-Net, and agreement, errors and doubts beside them.
        opacity: (V, 1, h, w) of the analysis.
        coarse_features: (V, C, h / 2, w / 2).
        cells: (V, 4, h / 2, w / 2) colour and level.
        level: (V, 1, H, W) depth, aligned, a level of its range.
        details: (V, 4, H, W) what the sources show less the photo, and the share of sources that see it.
    """

    images: Tensor
    logits: Tensor
    features: Tensor
    opacity: Tensor
    coarse_features: Tensor
    cells: Tensor
    level: Tensor
    details: Tensor


@dataclass(frozen=True)
class Dressed:
    """What the heads make of surfaces.

    Attributes:
        level: (V, 1, H, W) final depth.
        opacity: (V, 1, H, W), before other views have their say.
        footprint: (V, 1, H, W) pixels.
        colours: (V, 3, H, W).
        changes: of the coarse layer.
    """

    level: Tensor
    opacity: Tensor
    footprint: Tensor
    colours: Tensor
    changes: CoarseChanges


@dataclass(frozen=True)
class Prediction:
    """What training needs beside the Gaussians.

    Attributes:
        outputs: the tensors named by `OUTPUT_NAMES`.
        logits: (V, D, h, w) over candidates, half resolution.
        level: (V, 1, H, W) final depth as a level of `depths`.
        depths: the narrowed range that was swept.
        footprint: (V, 1, H, W) pixels.
        opacity: (V, 1, H, W).
        colours: (V, 3, H, W).
    """

    outputs: tuple[Tensor, ...]
    logits: Tensor
    level: Tensor
    depths: InverseDepths
    footprint: Tensor
    opacity: Tensor
    colours: Tensor


class CoarseHead(nn.Module):
    """Changes of the coarse layer, on its own grid: what is at the frame's border is continued into the ring.

    Three convolutions, dilated further and further, see how far a cell lies beyond the frame and what is there. Where
    nothing is known the mean colour of a neighbourhood is the better guess, so a cell's colour may turn to it.
    """

    def __init__(self, features: int, settings: EdgeSettings) -> None:
        super().__init__()
        self.settings = settings
        width = settings.coarse
        self.reduce = nn.Conv2d(features, width - 4, 1)
        self.mix = nn.ModuleList(convolution(width + 8 * (step == 1), width, dilation=step) for step in (1, 3, 9))
        self.out = zero(nn.Conv2d(width, 6 + len(settings.coarse_blurs), 1))

    def forward(self, features: Tensor, known: Tensor) -> CoarseChanges:
        """Changes on the padded grid from features (V, C, h, w) and colour and level (V, 4, h, w) of the cells."""
        s, ring = self.settings, self.settings.analysis.coarse.ring
        padding = (ring,) * 4
        maps = functional.pad(torch.cat([self.reduce(features), known], dim=1), padding, mode="replicate")
        colours = maps[:, -4:-1]
        blurs = [box_mean(colours, side) for side in s.coarse_blurs]
        inside = functional.pad(torch.ones_like(known[:, :1]), padding)
        near = box_mean(inside, 2 * ring + 1)  # falls with the distance from the frame
        x = torch.cat([maps, *(blur - colours for blur in blurs), inside, near.expand_as(inside)], dim=1)
        for layer in self.mix:
            x = functional.relu(layer(x))
        change = torch.tanh(self.out(x))
        depth_reach, width_reach = s.coarse_reach
        colour = s.colour_reach * change[:, 3:6]
        for i, blur in enumerate(blurs):
            colour = colour + change[:, 6 + i : 7 + i] * (blur - colours)
        return CoarseChanges(
            torch.exp(depth_reach * change[:, :1]), torch.exp(width_reach * change[:, 1:2]), 3 * change[:, 2:3], colour
        )


class Edge(nn.Module):
    """Posed photos to two layers of Gaussians."""

    def __init__(self, settings: EdgeSettings | None = None) -> None:
        super().__init__()
        self.settings = s = settings or EdgeSettings()
        width = s.widths[0]
        self.refiner = CostRefiner(3, 6, s.refiner)
        self.unet = FeatureUNet(2 * (2 * s.look + 1) + 8, s.widths)
        self.trust_costs = nn.Parameter(torch.tensor(1.0))
        self.upsampling = zero(nn.Conv2d(width, 36, 1))
        self.register_buffer("bilinear", bilinear_logits(), persistent=False)
        self.fine = nn.Sequential(
            convolution(width + 7, width), nn.ReLU(), nn.Conv2d(width, 4 * s.fine, 1), nn.PixelShuffle(2)
        )
        self.head = nn.Sequential(
            convolution(s.fine + 9, s.head),
            nn.ReLU(),
            convolution(s.head, s.head),
            nn.ReLU(),
            zero(convolution(s.head, 8)),
        )
        self.coarse = CoarseHead(s.widths[1], s)

    def forward(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> tuple[Tensor, ...]:
        """Predict Gaussians; arguments and result are those of `sweep.Sweep.forward`, H and W multiples of `STRIDE`."""
        return self.predict(images, K, c2w, near, far).outputs

    def predict(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> Prediction:
        """As `forward`, with what the losses use."""
        s = self.settings
        pairs, witnesses = ViewPairs.nearest(c2w), ViewPairs.all(c2w)
        whole = InverseDepths(1 / far, 1 / near - 1 / far, s.analysis.candidates)
        with _without_gradient():
            images, shown = one_exposure(images, K, pairs, whole, s.exposure, s.analysis)
        half = functional.avg_pool2d(images, 2)
        with _without_gradient():
            depths = narrowed(images, K, pairs, whole, s.narrowing, s.analysis)
            at_half = Comparison.on(half, K, pairs, depths)
            matches = match(half, at_half, s)
        estimate = self.estimate(half, at_half, matches, matches.level)
        views = MatchedViews(images, shown, K, c2w, far, depths)
        surfaces = self.seen(views, pairs, witnesses, estimate, estimate.level, estimate.agreement)
        dressed = self.dress(surfaces, depths)
        outputs, opacity = self.finish(dressed, views, witnesses, dressed.level, dressed.opacity)
        return Prediction(outputs, surfaces.logits, dressed.level, depths, dressed.footprint, opacity, dressed.colours)

    def estimate(self, half: Tensor, views: Comparison, matches: Matches, levels: Tensor) -> Estimate:
        """Depth at half resolution; arguments as for `analyse`."""
        s = self.settings
        with _without_gradient():
            analysis = analyse(half, views, matches, levels, s)
        own = views.pairs.own(half)
        logits = self._logits(own, analysis)
        level, confidence = expected_level(logits)
        features, coarse_features = self.unet(self._inputs(own, analysis, logits, level, confidence))
        full = convex_upsampling(level, self.upsampling(features) + self.bilinear)
        change = s.analysis.candidates / 8 * (level - analysis.level)
        return Estimate(
            logits, level, analysis.agreement, features, coarse_features, full, torch.cat([confidence, change], dim=1)
        )

    def seen(
        self,
        views: MatchedViews,
        pairs: ViewPairs,
        witnesses: ViewPairs,
        estimate: Estimate,
        levels: Tensor,
        agreements: Tensor,
    ) -> Surfaces:
        """What all views say of the depth that was estimated of those whose depth is sought.

        Args:
            views: all.
            pairs, witnesses: views that a view is matched with, and all that may witness that space is free.
            estimate: of the views whose depth is sought.
            levels, agreements: (…, 1, h, w) of the estimates of all views.
        """
        s, level, full = self.settings, estimate.level, estimate.full
        with _without_gradient():
            error, there, _ = error_in_sources(levels, views.on(level, pairs))
            opacity = opacities_from_agreement(levels, agreements, views.on(level, witnesses), s.analysis)
            at_full = views.on(full, pairs)
            aligned = align_photos(full.detach(), views.images, at_full, s.analysis.alignment)
            difference, visible = photo_difference(aligned, views.images, at_full)
        full = full + (aligned - full.detach())  # the gradient passes the alignment as if it were not there

        error = pairs.by_view(error.clamp(-4, 4) * there) / 4
        confidence, change = estimate.clues.split(1, dim=1)
        clues = [
            estimate.agreement,
            error.amin(dim=1),
            error.amax(dim=1),
            opacity,
            confidence,
            change,
            functional.avg_pool2d(difference, 2).abs().mean(1, True),
        ]
        cells = torch.cat([functional.avg_pool2d(views.shown, 4), functional.avg_pool2d(level.detach(), 2)], dim=1)
        details = torch.cat([4 * difference, visible], dim=1)
        return Surfaces(
            views.shown,
            estimate.logits,
            torch.cat([estimate.features, *clues], dim=1),
            opacity,
            estimate.coarse_features,
            cells,
            full,
            details,
        )

    def dress(self, surfaces: Surfaces, depths: InverseDepths) -> Dressed:
        """What the heads at full resolution and of the coarse layer make of surfaces in the ranges of their views."""
        s, own, images = self.settings, surfaces, surfaces.images
        fine = self.fine(own.features)
        opacity = double(own.opacity)
        relief = (s.analysis.candidates / 4 * (own.level - box_mean(own.level, 9))).clamp(-2, 2)
        change = self.head(torch.cat([fine, images - 0.5, own.details, relief, opacity], dim=1))

        unit = s.depth_reach / (s.analysis.candidates - 1)
        level = (own.level + unit * torch.tanh(change[:, :1])).clamp(0, 1)
        opacity = OPACITY_CAP * torch.sigmoid(torch.logit(opacity / OPACITY_CAP, 1e-3) + change[:, 1:2])
        least = s.least_footprint**2
        spread = torch.exp(2 * s.log_footprint_reach * torch.tanh(change[:, 2:3]))
        footprint = torch.sqrt(least + (s.analysis.footprint**2 - least) * spread)
        colour, gain, finer_gain = torch.tanh(change[:, 3:]).split([3, 1, 1], dim=1)
        reach, finer_reach = s.sharpening_reach
        with _without_gradient():
            weights = splat_weights(depths.at(level), opacity, footprint, s.analysis.surfaces)
        first, second = s.analysis.sharpening
        colours = sharpened(images, weights, first + reach * gain, second + finer_reach * finer_gain)
        colours = colours + s.colour_reach * colour
        return Dressed(level, opacity, footprint, colours, self.coarse(own.coarse_features, own.cells))

    def finish(
        self, dressed: Dressed, views: MatchedViews, witnesses: ViewPairs, levels: Tensor, opacities: Tensor
    ) -> tuple[tuple[Tensor, ...], Tensor]:
        """The tensors of `OUTPUT_NAMES`, and opacity, of what is dressed.

        Args:
            dressed: views whose Gaussians are sought.
            views: all.
            witnesses: as for `seen`.
            levels, opacities: (…, 1, H, W) of what is dressed of all views.
        """
        s = self.settings
        inverse_depths = views.depths.at(levels)
        inverse_depth = witnesses.own(inverse_depths)
        with _without_gradient():
            beside = views.on(levels, witnesses)
            kept = kept_opacity(levels.detach(), opacities.detach() / OPACITY_CAP, views.c2w, beside, s.witnesses)
        opacity = dressed.opacity * kept
        K, c2w = witnesses.own(views.K), witnesses.own(views.c2w)
        surface = pixel_layer(dressed.colours, K, c2w, inverse_depth, opacity, dressed.footprint)
        coarse = coarse_layer(
            views.shown,
            views.K,
            views.c2w,
            inverse_depths.detach(),
            views.far,
            witnesses,
            s.analysis.coarse,
            dressed.changes,
        )
        return (*surface.arrays(), *coarse.arrays(), coarse.K, 1 / inverse_depth[:, 0]), opacity

    def _logits(self, half: Tensor, analysis: Analysis) -> Tensor:
        """Logits (V, D, h, w) over candidates: the analysis's, and what the refiner adds at quarter resolution."""
        s = self.settings
        quarter = functional.avg_pool2d(half, 2)
        gray = quarter.mean(dim=1, keepdim=True)
        contrast = local_contrast(gray, s.analysis.contrast_window, floor=0.03)
        agreement = functional.avg_pool2d(torch.cat([analysis.agreement, analysis.best_cost], dim=1), 2)
        raw = functional.avg_pool2d(analysis.relative_cost, 2)
        aggregated = functional.avg_pool2d(torch.exp(-s.likelihood * analysis.paths), 2)
        coarse = torch.exp(-s.likelihood * analysis.coarse_paths)
        maps = torch.cat([quarter - 0.5, 0.5 * contrast, agreement], dim=1)
        added = self.refiner(torch.stack([raw, aggregated, coarse], dim=1), maps)
        return self._prior(analysis) + double(added)

    def _inputs(self, half: Tensor, analysis: Analysis, logits: Tensor, level: Tensor, confidence: Tensor) -> Tensor:
        """The U-Net's input (V, 4·look + 10, h, w): nothing in it tells absolute depth; all is of the order of one."""
        s = self.settings
        last = s.analysis.candidates - 1
        offsets = torch.arange(-s.look, s.look + 1, device=level.device)[:, None, None]
        index = (torch.round(last * level.detach()).long() + offsets).clamp(0, last)
        beside = (logits - logits.amax(dim=1, keepdim=True)).gather(1, index)
        raw = analysis.relative_cost.gather(1, index)
        contrast = local_contrast(half.mean(dim=1, keepdim=True), s.analysis.contrast_window, floor=0.03)
        relief = (last / 8 * (level - box_mean(level, 17))).clamp(-2, 2)
        maps = [half - 0.5, 0.5 * contrast, relief, analysis.agreement, analysis.best_cost, confidence]
        return torch.cat([torch.exp(0.5 * beside), raw, *maps], dim=1)

    def _prior(self, analysis: Analysis) -> Tensor:
        """Logits (V, D, h, w) of the analysis alone: its depth, and its costs with a learned weight."""
        s = self.settings
        count = s.analysis.candidates
        index = torch.arange(count, dtype=analysis.level.dtype, device=analysis.level.device)[:, None, None]
        distance = (index - (count - 1) * analysis.level) / s.prior_width
        return (-0.5 * distance.square()).clamp_min(s.prior_floor) - self.trust_costs * analysis.paths.clamp_max(4)


def _without_gradient() -> AbstractContextManager[None]:
    """No gradient inside; a tracer, which needs none, is not told."""
    return nullcontext() if torch.compiler.is_compiling() else torch.no_grad()
