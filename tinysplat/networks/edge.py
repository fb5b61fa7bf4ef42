"""`edge`: a small learned network that starts from `sweep` and corrects it.

A look at a coarse grid leaves out depths that the scene does not have (`narrowing`). The analytic part is `sweep`'s:
matching costs, semi-global aggregation, filling, agreement between views, and Gaussians by construction; its costs are
led by those of two coarser grids. A refiner whose weights are the same for every
candidate adds to the logits over inverse depth at quarter resolution: it can learn what a good match looks like, and
no liking for a depth. A U-Net at half resolution sees the costs about the depth that was found; a learned convex
upsampling keeps depth edges sharp; a head at full resolution changes depth, opacity, footprint and colour within
bounds, and a small one the coarse layer. The last layer of every head starts at zero, so that the untrained network is
the analysis and training can only move it from there.

Convex upsampling is after Teed and Deng, "RAFT" (2020), section 3.3.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from .aggregation import box_mean, local_contrast
from .edge_layers import CostRefiner, UNet, convolution, zero
from .exposure import ExposureSettings, one_exposure
from .geometry import inside_frame, pixel_intrinsics, pixel_rays, project_sweep, sample_bilinear
from .narrowing import NarrowingSettings, narrowed
from .pairs import ViewPairs
from .surfels import CoarseChanges, coarse_layer, pixel_layer, sharpened, splat_weights
from .sweep import (
    MAX_VIEWS,
    MIN_VIEWS,
    OUTPUT_NAMES,
    AlignmentSettings,
    InverseDepths,
    SweepSettings,
    align_photos,
    double,
    error_in_sources,
    matched,
    opacities_from_agreement,
    settled,
)
from .witnesses import WitnessSettings, kept_opacity

__all__ = ["MAX_VIEWS", "MIN_SIDE", "MIN_VIEWS", "OUTPUT_NAMES", "STRIDE", "Edge", "EdgeSettings"]

STRIDE = 16
"""Image sides are multiples of it: the U-Net's coarsest grid."""

MIN_SIDE = 32

WINDOW = 2
"""Candidates on each side of the best that the expected depth is taken over."""

OPACITY_CAP = 0.75
"""Bound on a surface Gaussian's opacity: changes of depth order by coding stay small (`TrustSettings.opacity`)."""


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


@dataclass(frozen=True)
class Surfaces:
    """What the heads start from: surfaces found, and what tells how well.

    Attributes:
        images: (V, 3, H, W).
        K, c2w, far: as `Edge.forward` has them.
        depths: the narrowed range that was swept.
        logits: (V, D, h, w) over candidates, half resolution.
        features: (V, C, h, w) of the U-Net, and agreement, errors and doubts beside them.
        opacity: (V, 1, h, w) of the analysis.
        coarse_features: (V, C, h / 2, w / 2).
        cells: (V, 4, h / 2, w / 2) colour and level.
        level: (V, 1, H, W) depth, aligned, a level of `depths`.
        details: (V, 4, H, W) what the sources show less the photo, and the share of sources that see it.
    """

    images: Tensor
    K: Tensor
    c2w: Tensor
    far: Tensor
    depths: InverseDepths
    logits: Tensor
    features: Tensor
    opacity: Tensor
    coarse_features: Tensor
    cells: Tensor
    level: Tensor
    details: Tensor


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
        self.unet = UNet(2 * (2 * s.look + 1) + 8, s.widths)
        self.trust_costs = nn.Parameter(torch.tensor(1.0))
        self.upsampling = zero(nn.Conv2d(width, 36, 1))
        self.register_buffer("bilinear", _bilinear_logits(), persistent=False)
        self.fine = nn.Sequential(
            convolution(width + 7, width), nn.ReLU(), nn.Conv2d(width, 4 * s.fine, 1), nn.PixelShuffle(2)
        )
        self.head = nn.Sequential(
            convolution(s.fine + 9, s.head), nn.ReLU(), convolution(s.head, s.head), nn.ReLU(),
            zero(convolution(s.head, 8)),
        )  # fmt: skip
        self.coarse = CoarseHead(s.widths[1], s)

    def forward(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> tuple[Tensor, ...]:
        """Predict Gaussians; arguments and result are those of `sweep.Sweep.forward`, H and W multiples of `STRIDE`."""
        return self.predict(images, K, c2w, near, far).outputs

    def predict(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> Prediction:
        """As `forward`, with what the losses look at."""
        return self.dress(self.find(images, K, c2w, near, far))

    def find(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> Surfaces:
        """Where the surfaces are: the analysis, the refiner and the U-Net; arguments as for `forward`."""
        s = self.settings
        pairs, witnesses = ViewPairs.nearest(c2w), ViewPairs.all(c2w)
        whole = InverseDepths(1 / far, 1 / near - 1 / far, s.analysis.candidates)
        with _without_gradient():
            images = one_exposure(images, K, pairs, whole, s.exposure, s.analysis)
        half = functional.avg_pool2d(images, 2)
        rays = pixel_rays(pixel_intrinsics(K, half.shape[2], half.shape[3]), half.shape[2], half.shape[3])
        terms = pairs.sweep_terms(rays, K)
        with _without_gradient():
            depths = narrowed(images, K, pairs, whole, s.narrowing, s.analysis)
            found = analyse(half, K, terms, pairs, depths, s)

        logits = self._logits(half, found)
        level, confidence = expected_level(logits)
        features, coarse_features = self.unet(self._inputs(half, found, logits, level, confidence))
        full = convex_upsampling(level, self.upsampling(features) + self.bilinear)
        with _without_gradient():
            error, seen, _ = error_in_sources(level, terms, pairs, depths)
            opacity = opacities_from_agreement(
                level, found.agreement, witnesses.sweep_terms(rays, K), witnesses, depths, s.analysis
            )
            aligned = align_photos(full.detach(), images, K, pairs, depths, s.analysis.alignment)
            difference, visible = photo_difference(aligned, images, K, pairs, depths)
        full = full + (aligned - full.detach())  # the gradient passes the alignment as if it were not there

        error = pairs.by_view(error.clamp(-4, 4) * seen) / 4
        clues = [
            found.agreement, error.amin(dim=1), error.amax(dim=1), opacity, confidence,
            s.analysis.candidates / 8 * (level - found.level),
            functional.avg_pool2d(difference, 2).abs().mean(1, True),
        ]  # fmt: skip
        cells = functional.avg_pool2d(torch.cat([half, level.detach()], dim=1), 2)
        details = torch.cat([4 * difference, visible], dim=1)
        return Surfaces(
            images, K, c2w, far, depths, logits, torch.cat([features, *clues], dim=1), opacity, coarse_features, cells,
            full, details,
        )  # fmt: skip

    def dress(self, surfaces: Surfaces) -> Prediction:
        """Gaussians on the surfaces: what the heads at full resolution and of the coarse layer make of them."""
        s, found, images = self.settings, surfaces, surfaces.images
        witnesses = ViewPairs.all(found.c2w)
        fine = self.fine(found.features)
        opacity = double(found.opacity)
        relief = (s.analysis.candidates / 4 * (found.level - box_mean(found.level, 9))).clamp(-2, 2)
        change = self.head(torch.cat([fine, images - 0.5, found.details, relief, opacity], dim=1))

        unit = s.depth_reach / (s.analysis.candidates - 1)
        level = (found.level + unit * torch.tanh(change[:, :1])).clamp(0, 1)
        opacity = OPACITY_CAP * torch.sigmoid(torch.logit(opacity / OPACITY_CAP, 1e-3) + change[:, 1:2])
        least = s.least_footprint**2
        spread = torch.exp(2 * s.log_footprint_reach * torch.tanh(change[:, 2:3]))
        footprint = torch.sqrt(least + (s.analysis.footprint**2 - least) * spread)
        colour, gain, finer_gain = torch.tanh(change[:, 3:]).split([3, 1, 1], dim=1)
        reach, finer_reach = s.sharpening_reach
        inverse_depth = found.depths.at(level)
        with _without_gradient():
            weights = splat_weights(inverse_depth, opacity, footprint, s.analysis.surfaces)
            kept = kept_opacity(
                level.detach(), opacity.detach() / OPACITY_CAP, found.K, found.c2w, witnesses, found.depths, s.witnesses
            )
        first, second = s.analysis.sharpening
        colours = sharpened(images, weights, first + reach * gain, second + finer_reach * finer_gain)
        colours = colours + s.colour_reach * colour
        opacity = opacity * kept
        surface = pixel_layer(colours, found.K, found.c2w, inverse_depth, opacity, footprint)
        changes = self.coarse(found.coarse_features, found.cells)
        coarse = coarse_layer(
            images, found.K, found.c2w, inverse_depth.detach(), found.far, witnesses, s.analysis.coarse, changes
        )
        outputs = (*surface.arrays(), *coarse.arrays(), coarse.K, 1 / inverse_depth[:, 0])
        return Prediction(outputs, found.logits, level, found.depths, footprint, opacity, colours)

    def _logits(self, half: Tensor, found: Analysis) -> Tensor:
        """Logits (V, D, h, w) over candidates: the analysis's, and what the refiner adds at quarter resolution."""
        s = self.settings
        quarter = functional.avg_pool2d(half, 2)
        gray = quarter.mean(dim=1, keepdim=True)
        contrast = local_contrast(gray, s.analysis.contrast_window, floor=0.03)
        agreement = functional.avg_pool2d(torch.cat([found.agreement, found.best_cost], dim=1), 2)
        raw = functional.avg_pool2d(found.relative_cost, 2)
        aggregated = functional.avg_pool2d(torch.exp(-s.likelihood * found.paths), 2)
        coarse = torch.exp(-s.likelihood * found.coarse_paths)
        maps = torch.cat([quarter - 0.5, 0.5 * contrast, agreement], dim=1)
        added = self.refiner(torch.stack([raw, aggregated, coarse], dim=1), maps)
        return self._prior(found) + double(added)

    def _inputs(self, half: Tensor, found: Analysis, logits: Tensor, level: Tensor, confidence: Tensor) -> Tensor:
        """The U-Net's input (V, 4·look + 10, h, w): nothing in it tells absolute depth; all is of the order of one."""
        s = self.settings
        last = s.analysis.candidates - 1
        offsets = torch.arange(-s.look, s.look + 1, device=level.device)[:, None, None]
        index = (torch.round(last * level.detach()).long() + offsets).clamp(0, last)
        beside = (logits - logits.amax(dim=1, keepdim=True)).gather(1, index)
        raw = found.relative_cost.gather(1, index)
        contrast = local_contrast(half.mean(dim=1, keepdim=True), s.analysis.contrast_window, floor=0.03)
        relief = (last / 8 * (level - box_mean(level, 17))).clamp(-2, 2)
        maps = [half - 0.5, 0.5 * contrast, relief, found.agreement, found.best_cost, confidence]
        return torch.cat([torch.exp(0.5 * beside), raw, *maps], dim=1)

    def _prior(self, found: Analysis) -> Tensor:
        """Logits (V, D, h, w) of the analysis alone: its depth, and its costs with a learned weight."""
        s = self.settings
        count = s.analysis.candidates
        index = torch.arange(count, dtype=found.level.dtype, device=found.level.device)[:, None, None]
        distance = (index - (count - 1) * found.level) / s.prior_width
        return (-0.5 * distance.square()).clamp_min(s.prior_floor) - self.trust_costs * found.paths.clamp_max(4)


def analyse(
    half: Tensor, K: Tensor, terms: tuple[Tensor, Tensor], pairs: ViewPairs, depths: InverseDepths,
    settings: EdgeSettings,
) -> Analysis:  # fmt: skip
    """The first half of `sweep`: matching, aggregation, agreement, filling and alignment at half resolution.

    A coarser grid's aggregated costs are added, with a small weight, to the costs of the next finer one: large blank or
    repeated things are matched by what surrounds them.
    """
    s = settings.analysis
    fine = replace(s, colour_weight=settings.fine_colour_weight, contrast_weight=0.0)
    grids = [(half, terms[0])]
    for _ in range(settings.coarser_grids):
        grids.append((functional.avg_pool2d(grids[-1][0], 2), functional.avg_pool2d(grids[-1][1], 2)))
    lead = torch.zeros(())
    coarse = lead
    for guide, turned in reversed(grids):
        at_half = guide is half
        cost, paths = matched(guide, (turned, terms[1]), pairs, depths, fine if at_half else s, lead)
        if not at_half:
            coarse = paths
            lead = double(settings.lead * paths.clamp_max(settings.lead_limit))
    level, agreement = settled(paths, half, terms, pairs, depths, s)
    level = align_photos(level, half, K, pairs, depths, settings.half_alignment)
    relative = settings.contrast * (cost - cost.mean(dim=1, keepdim=True))
    best = settings.contrast * cost.amin(dim=1, keepdim=True)
    return Analysis(relative, best, paths, coarse, level, agreement)


def expected_level(logits: Tensor) -> tuple[Tensor, Tensor]:
    """Level (V, 1, h, w) about the most likely candidate, and the probability of that neighbourhood."""
    count = logits.shape[1]
    index = torch.arange(count, dtype=logits.dtype, device=logits.device)[:, None, None]
    best = logits.argmax(dim=1, keepdim=True).to(logits.dtype)
    near = torch.softmax(logits, dim=1) * ((index - best).abs() < WINDOW + 0.5)
    mass = near.sum(dim=1, keepdim=True)
    return (near * index).sum(dim=1, keepdim=True) / mass / (count - 1), mass


def convex_upsampling(values: Tensor, logits: Tensor) -> Tensor:
    """Twice the resolution: every new pixel a convex combination of the 3 × 3 old ones around it.

    Args:
        values: (V, 1, h, w).
        logits: (V, 36, h, w), nine for each of the four new pixels: index 4·neighbour + new pixel.

    Returns:
        (V, 1, 2h, 2w).
    """
    height, width = values.shape[2:]
    padded = functional.pad(values, (1, 1, 1, 1), mode="replicate")
    around = [padded[:, :, i : i + height, j : j + width] for i in range(3) for j in range(3)]
    weights = torch.softmax(logits.unflatten(1, (9, 4)), dim=1)
    return functional.pixel_shuffle((weights * torch.stack(around, dim=1)).sum(dim=1), 2)


def photo_difference(
    level: Tensor, images: Tensor, K: Tensor, pairs: ViewPairs, depths: InverseDepths
) -> tuple[Tensor, Tensor]:
    """What the sources show at each pixel's place less the pixel itself, (V, 3, H, W), mean of those that see it.

    The second result is the share of sources that have the place in their frame, (V, 1, H, W).
    """
    height, width = images.shape[2:]
    rays = pixel_rays(pixel_intrinsics(K, height, width), height, width)
    x, y, ratio = project_sweep(*pairs.sweep_terms(rays, K), depths.at(level)[pairs.reference])
    read = sample_bilinear(images[pairs.source], x, y)[:, :, 0]
    seen = inside_frame(x, y, ratio)
    total = pairs.by_view((read - images[pairs.reference]) * seen).sum(dim=1)
    count = pairs.by_view(seen).sum(dim=1)
    return total / count.clamp_min(1), count / pairs.sources


def _bilinear_logits() -> Tensor:
    """Logits (1, 36, 1, 1) with which `convex_upsampling` is bilinear interpolation, but for a floor of 1e-3."""
    along = torch.tensor([[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]])  # (new, old)
    weights = torch.einsum("ai,bj->ijab", along, along).reshape(1, 36, 1, 1)
    return torch.log(weights.clamp_min(1e-3))


def _without_gradient() -> AbstractContextManager[None]:
    """No gradient inside; a tracer, which needs none, is not told."""
    return nullcontext() if torch.compiler.is_compiling() else torch.no_grad()
