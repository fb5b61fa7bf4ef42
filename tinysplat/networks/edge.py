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

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from .aggregation import box_mean, local_contrast
from .edge_analysis import ANALYSIS, Analysis, Matches, analyse, expected_level, match, photo_difference
from .edge_layers import CostRefiner, FeatureUNet, bilinear_logits, convex_upsampling, convolution, zero
from .exposure import one_exposure
from .narrowing import narrowed
from .pairs import ViewPairs
from .surfels import RING, CoarseChanges, coarse_layer, pixel_layer, sharpened, splat_weights
from .sweep import (
    FOOTPRINT,
    MAX_VIEWS,
    MIN_VIEWS,
    OUTPUT_NAMES,
    SHARPENING,
    Comparison,
    InverseDepths,
    align_photos,
    double,
    error_in_sources,
    opacities_from_agreement,
)
from .witnesses import kept_opacity

__all__ = ["MAX_VIEWS", "MIN_SIDE", "MIN_VIEWS", "OUTPUT_NAMES", "STRIDE", "Edge"]

STRIDE = 16
"""Image sides are multiples of it: the U-Net's coarsest grid."""

MIN_SIDE = 32

OPACITY_CAP = 31 / 32
"""Bound on a surface Gaussian's opacity: nearly none, as where depth is sure what lies behind should not show."""

WIDTHS = (32, 64, 96, 96)
"""Channels of the U-Net at 1/2, 1/4, 1/8 and 1/16 resolution."""

FINE, HEAD, REFINER, COARSE = 8, 16, 8, 32
"""Channels that the U-Net hands to each pixel of full resolution, of the head there, of the refiner of costs, and of
the coarse layer's head."""

LOOK = 3
"""Candidates on each side of the depth found whose costs the U-Net sees."""

LIKELIHOOD = 3.0
"""Fall of a candidate's input value with its aggregated cost."""

PRIOR_WIDTH, PRIOR_FLOOR = 0.7, -8.0
"""Standard deviation of the analytic depth's prior over candidates, candidates, and lowest log value of that prior."""

DEPTH_REACH, COLOUR_REACH, SHARPENING_REACH = 1.0, 0.15, (1.0, 1.0)
"""Bounds on the head's changes of depth, candidates, of colour, and of the factors of `sharpened`."""

LEAST_FOOTPRINT = 0.4
"""Standard deviation in pixels that every surface Gaussian has at least: a surface is closed by its own Gaussians,
however near one goes."""

LOG_FOOTPRINT_REACH = 1.2
"""Bound on the change of the logarithm of what is added to that in quadrature."""

COARSE_BLURS = (9, 33)
"""Sides of the boxes, cells, whose mean colours a coarse Gaussian may turn to."""

COARSE_REACH = (0.5, 0.7)
"""Bounds on the changes of the logarithms of the coarse layer's inverse depth and width."""


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

    def __init__(self, features: int) -> None:
        super().__init__()
        width = COARSE
        self.reduce = nn.Conv2d(features, width - 4, 1)
        self.mix = nn.ModuleList(convolution(width + 8 * (step == 1), width, dilation=step) for step in (1, 3, 9))
        self.out = zero(nn.Conv2d(width, 6 + len(COARSE_BLURS), 1))

    def forward(self, features: Tensor, known: Tensor) -> CoarseChanges:
        """Changes on the padded grid from features (V, C, h, w) and colour and level (V, 4, h, w) of the cells."""
        padding = (RING,) * 4
        maps = functional.pad(torch.cat([self.reduce(features), known], dim=1), padding, mode="replicate")
        colours = maps[:, -4:-1]
        blurs = [box_mean(colours, side) for side in COARSE_BLURS]
        inside = functional.pad(torch.ones_like(known[:, :1]), padding)
        near = box_mean(inside, 2 * RING + 1)  # falls with the distance from the frame
        x = torch.cat([maps, *(blur - colours for blur in blurs), inside, near.expand_as(inside)], dim=1)
        for layer in self.mix:
            x = functional.relu(layer(x))
        change = torch.tanh(self.out(x))
        depth_reach, width_reach = COARSE_REACH
        colour = COLOUR_REACH * change[:, 3:6]
        for i, blur in enumerate(blurs):
            colour = colour + change[:, 6 + i : 7 + i] * (blur - colours)
        return CoarseChanges(
            torch.exp(depth_reach * change[:, :1]), torch.exp(width_reach * change[:, 1:2]), 3 * change[:, 2:3], colour
        )


class Edge(nn.Module):
    """Posed photos to two layers of Gaussians."""

    def __init__(self) -> None:
        super().__init__()
        width = WIDTHS[0]
        self.refiner = CostRefiner(3, 6, REFINER)
        self.unet = FeatureUNet(2 * (2 * LOOK + 1) + 8, WIDTHS)
        self.trust_costs = nn.Parameter(torch.tensor(1.0))
        self.upsampling = zero(nn.Conv2d(width, 36, 1))
        self.register_buffer("bilinear", bilinear_logits(), persistent=False)
        self.fine = nn.Sequential(
            convolution(width + 7, width), nn.ReLU(), nn.Conv2d(width, 4 * FINE, 1), nn.PixelShuffle(2)
        )
        self.head = nn.Sequential(
            convolution(FINE + 9, HEAD), nn.ReLU(), convolution(HEAD, HEAD), nn.ReLU(), zero(convolution(HEAD, 8))
        )
        self.coarse = CoarseHead(WIDTHS[1])

    def forward(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> tuple[Tensor, ...]:
        """Predict Gaussians; arguments and result are those of `sweep.Sweep.forward`, H and W multiples of `STRIDE`."""
        return self.predict(images, K, c2w, near, far).outputs

    def predict(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> Prediction:
        """As `forward`, with what the losses use."""
        pairs, witnesses = ViewPairs.nearest(c2w), ViewPairs.all(c2w)
        whole = InverseDepths(1 / far, 1 / near - 1 / far, ANALYSIS.candidates)
        with _without_gradient():
            images, shown = one_exposure(images, K, pairs, whole, ANALYSIS)
        half = functional.avg_pool2d(images, 2)
        with _without_gradient():
            depths = narrowed(images, K, pairs, whole, ANALYSIS)
            at_half = Comparison.on(half, K, pairs, depths)
            matches = match(half, at_half)
        estimate = self.estimate(half, at_half, matches, matches.level)
        views = MatchedViews(images, shown, K, c2w, far, depths)
        surfaces = self.seen(views, pairs, witnesses, estimate, estimate.level, estimate.agreement)
        dressed = self.dress(surfaces, depths)
        outputs, opacity = self.finish(dressed, views, witnesses, dressed.level, dressed.opacity)
        return Prediction(outputs, surfaces.logits, dressed.level, depths, dressed.footprint, opacity, dressed.colours)

    def estimate(self, half: Tensor, views: Comparison, matches: Matches, levels: Tensor) -> Estimate:
        """Depth at half resolution; arguments as for `analyse`."""
        with _without_gradient():
            analysis = analyse(half, views, matches, levels)
        own = views.pairs.own(half)
        logits = self._logits(own, analysis)
        level, confidence = expected_level(logits)
        features, coarse_features = self.unet(self._inputs(own, analysis, logits, level, confidence))
        full = convex_upsampling(level, self.upsampling(features) + self.bilinear)
        change = ANALYSIS.candidates / 8 * (level - analysis.level)
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
        level, full = estimate.level, estimate.full
        with _without_gradient():
            error, there, _ = error_in_sources(levels, views.on(level, pairs))
            opacity = opacities_from_agreement(levels, agreements, views.on(level, witnesses), ANALYSIS)
            at_full = views.on(full, pairs)
            aligned = align_photos(full.detach(), views.images, at_full, ANALYSIS.alignment)
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
        own, images = surfaces, surfaces.images
        fine = self.fine(own.features)
        opacity = double(own.opacity)
        relief = (ANALYSIS.candidates / 4 * (own.level - box_mean(own.level, 9))).clamp(-2, 2)
        change = self.head(torch.cat([fine, images - 0.5, own.details, relief, opacity], dim=1))

        unit = DEPTH_REACH / (ANALYSIS.candidates - 1)
        level = (own.level + unit * torch.tanh(change[:, :1])).clamp(0, 1)
        opacity = OPACITY_CAP * torch.sigmoid(torch.logit(opacity / OPACITY_CAP, 1e-3) + change[:, 1:2])
        least = LEAST_FOOTPRINT**2
        spread = torch.exp(2 * LOG_FOOTPRINT_REACH * torch.tanh(change[:, 2:3]))
        footprint = torch.sqrt(least + (FOOTPRINT**2 - least) * spread)
        colour, gain, finer_gain = torch.tanh(change[:, 3:]).split([3, 1, 1], dim=1)
        reach, finer_reach = SHARPENING_REACH
        with _without_gradient():
            weights = splat_weights(depths.at(level), opacity, footprint)
        first, second = SHARPENING
        colours = sharpened(images, weights, first + reach * gain, second + finer_reach * finer_gain)
        colours = colours + COLOUR_REACH * colour
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
        inverse_depths = views.depths.at(levels)
        inverse_depth = witnesses.own(inverse_depths)
        with _without_gradient():
            beside = views.on(levels, witnesses)
            kept = kept_opacity(levels.detach(), opacities.detach() / OPACITY_CAP, views.c2w, beside)
        opacity = dressed.opacity * kept
        K, c2w = witnesses.own(views.K), witnesses.own(views.c2w)
        surface = pixel_layer(dressed.colours, K, c2w, inverse_depth, opacity, dressed.footprint)
        coarse = coarse_layer(
            views.shown, views.K, views.c2w, inverse_depths.detach(), views.far, witnesses, dressed.changes
        )
        return (*surface.arrays(), *coarse.arrays(), coarse.K, 1 / inverse_depth[:, 0]), opacity

    def _logits(self, half: Tensor, analysis: Analysis) -> Tensor:
        """Logits (V, D, h, w) over candidates: the analysis's, and what the refiner adds at quarter resolution."""
        quarter = functional.avg_pool2d(half, 2)
        gray = quarter.mean(dim=1, keepdim=True)
        contrast = local_contrast(gray)
        agreement = functional.avg_pool2d(torch.cat([analysis.agreement, analysis.best_cost], dim=1), 2)
        raw = functional.avg_pool2d(analysis.relative_cost, 2)
        aggregated = functional.avg_pool2d(torch.exp(-LIKELIHOOD * analysis.paths), 2)
        coarse = torch.exp(-LIKELIHOOD * analysis.coarse_paths)
        maps = torch.cat([quarter - 0.5, 0.5 * contrast, agreement], dim=1)
        added = self.refiner(torch.stack([raw, aggregated, coarse], dim=1), maps)
        return self._prior(analysis) + double(added)

    def _inputs(self, half: Tensor, analysis: Analysis, logits: Tensor, level: Tensor, confidence: Tensor) -> Tensor:
        """The U-Net's input (V, 4·look + 10, h, w): nothing in it tells absolute depth; all is of the order of one."""
        last = ANALYSIS.candidates - 1
        offsets = torch.arange(-LOOK, LOOK + 1, device=level.device)[:, None, None]
        index = (torch.round(last * level.detach()).long() + offsets).clamp(0, last)
        beside = (logits - logits.amax(dim=1, keepdim=True)).gather(1, index)
        raw = analysis.relative_cost.gather(1, index)
        contrast = local_contrast(half.mean(dim=1, keepdim=True))
        relief = (last / 8 * (level - box_mean(level, 17))).clamp(-2, 2)
        maps = [half - 0.5, 0.5 * contrast, relief, analysis.agreement, analysis.best_cost, confidence]
        return torch.cat([torch.exp(0.5 * beside), raw, *maps], dim=1)

    def _prior(self, analysis: Analysis) -> Tensor:
        """Logits (V, D, h, w) of the analysis alone: its depth, and its costs with a learned weight."""
        count = ANALYSIS.candidates
        index = torch.arange(count, dtype=analysis.level.dtype, device=analysis.level.device)[:, None, None]
        distance = (index - (count - 1) * analysis.level) / PRIOR_WIDTH
        return (-0.5 * distance.square()).clamp_min(PRIOR_FLOOR) - self.trust_costs * analysis.paths.clamp_max(4)


def _without_gradient() -> AbstractContextManager[None]:
    """No gradient inside; a tracer, which needs none, is not told."""
    return nullcontext() if torch.compiler.is_compiling() else torch.no_grad()
