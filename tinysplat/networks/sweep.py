"""`sweep`: a feedforward network without learned weights.

A plane sweep after Collins 1996 whose every stage is a fixed graph: photo-consistency over inverse-depth candidates,
semi-global aggregation, soft-argmin, cross-view consistency, filling, and Gaussians by construction. It makes the
product useful on any scene at once and is the baseline that a learned network has to beat.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from .aggregation import box_mean, fill_uncertain, local_contrast, path_costs
from .geometry import BEHIND, inside_frame, pixel_intrinsics, pixel_rays, project_sweep, sample_bilinear
from .pairs import ViewPairs
from .surfels import coarse_layer, pixel_layer, sharpened, splat_weights

OUTPUT_NAMES = (
    *("means", "quats", "scales", "opacities", "sh"),
    *("layer1_means", "layer1_quats", "layer1_scales", "layer1_opacities", "layer1_sh", "layer1_K"),
    "depth",
)
"""Names of what `Sweep.forward` returns, in order."""

MIN_VIEWS, MAX_VIEWS = 2, 6
STRIDE = 4
"""Image sides are multiples of it: the coarse layer's cell."""
MIN_SIDE = 32

REACH, LARGEST_STEP = 0.5, 1.0
"""Of aligning: half the distance between the samples of the derivative, and bound on a step, candidates."""

OUTLIER, DAMPING = 0.1, 1e-3
"""Colour difference from which a pixel's weight falls, and what is added to the curvature: flat places stay."""


@dataclass(frozen=True)
class AlignmentSettings:
    """`align_photos`.

    Attributes:
        steps: Gauss-Newton steps.
        window: side of the box, pixels, whose pixels move together.
        any_exposure: whether a box may differ from the source by a constant colour, which then tells nothing.
    """

    steps: int = 2
    window: int = 11
    any_exposure: bool = False


OPACITY = 0.6
"""Of a Gaussian that all views agree with. Below 1 on purpose: neighbours overlap, so that the surface is closed all
the same, and a change of their depth order by coding changes the picture four times less than at 0.95 (squared error),
which is what most of the paper's coding error comes from."""

AGREEMENT_SHARE = 0.8
"""Share of opacity lost without any agreement."""

HIDDEN, UNSEEN = 0.5, 0.4
"""Agreement of a pixel that is behind what every source sees there, and of one that no source has in its frame."""

INTRUSION_SHARE = 0.5
"""Share of opacity lost by a Gaussian in the free space before what a source sees."""

INTRUSION_FROM, INTRUSION_RAMP = 1.0, 2.0
"""Candidates in front at which that begins, and over which it grows."""

LEAST_WITNESS = 0.3
"""Least weight of a source's own agreement in that."""

COLOUR_LIMIT, CONTRAST_LIMIT = 0.12, 1.0
"""Where differences of colour and of local contrast are cut."""

WINDOW = 3
"""Side of the box that costs are averaged over."""

UNSEEN_COST, UNSEEN_AGREEMENT = 0.2, 0.3
"""Of a candidate, and before filling of a pixel, that no other view has in its frame."""

SHARPNESS = 12.0
"""Inverse temperature of the soft-argmin."""

FOOTPRINT = 0.45
"""Standard deviation of a Gaussian on a frontal surface, pixels: wide enough that its own Gaussians close a surface,
however near one goes."""

SHARPENING = (1.0, 1.0)
"""Factors on what drawing takes from a photo, and on what it takes from that (`sharpened`)."""


@dataclass(frozen=True)
class SweepSettings:
    """What networks that sweep differ in; costs are of the order of one.

    Attributes:
        candidates: inverse depths from far to near, uniform.
        colour_weight: weight of the mean absolute colour difference.
        contrast_weight: weight of the absolute difference of local contrast; at 0 it is not looked at.
        consistency: standard deviation of the cross-view error that still counts as agreement, candidates.
        fill_dilations: of `aggregation.fill_uncertain`.
        alignment: the last step at full resolution.
    """

    candidates: int = 56
    colour_weight: float = 1.5
    contrast_weight: float = 0.15
    consistency: float = 1.5
    fill_dilations: tuple[int, ...] = (1, 2, 4, 8, 8, 8)
    alignment: AlignmentSettings = field(default_factory=AlignmentSettings)


class Sweep(nn.Module):
    """Posed photos to two layers of Gaussians."""

    def forward(self, images: Tensor, K: Tensor, c2w: Tensor, near: Tensor, far: Tensor) -> tuple[Tensor, ...]:
        """Predict Gaussians.

        Args:
            images: (V, 3, H, W) float32 RGB in [0, 1]; V from 2 to 6, H and W multiples of `STRIDE`.
            K: (V, 3, 3) float32, divided by image width and height.
            c2w: (V, 4, 4) float32 near the origin.
            near: (V,) float32, z of the nearest surface, > 0.
            far: (V,) float32, z of the farthest surface, > near.

        Returns:
            The tensors named by `OUTPUT_NAMES`.
        """
        settings = SweepSettings()
        pairs, witnesses = ViewPairs.nearest(c2w), ViewPairs.all(c2w)
        depths = InverseDepths(1 / far, 1 / near - 1 / far, settings.candidates)
        half = functional.avg_pool2d(images, 2)
        views = Comparison.on(half, K, pairs, depths)
        _, paths = matched(half, views, settings)
        level, agreement = settled(paths, half, views, settings)
        opacities = opacities_from_agreement(level, agreement, Comparison.on(half, K, witnesses, depths), settings)

        level = align_photos(double(level), images, Comparison.on(images, K, pairs, depths), settings.alignment)
        inverse_depth = depths.at(level)
        opacities = double(opacities)
        weights = splat_weights(inverse_depth, opacities, FOOTPRINT)
        colours = sharpened(images, weights, *SHARPENING)
        surface = pixel_layer(colours, K, c2w, inverse_depth, opacities, FOOTPRINT)
        coarse = coarse_layer(images, K, c2w, inverse_depth, far, witnesses)
        return *surface.arrays(), *coarse.arrays(), coarse.K, 1 / inverse_depth[:, 0]


@dataclass(frozen=True)
class InverseDepths:
    """The swept range of each view: level 0 is the far plane, level 1 the near plane, linear in inverse depth.

    Attributes:
        offset: (V,) inverse depth of the far plane.
        span: (V,) inverse depth of the near plane less that of the far plane.
        count: number of candidates.
    """

    offset: Tensor
    span: Tensor
    count: int

    def at(self, level: Tensor) -> Tensor:
        """Inverse depth of levels (V, …)."""
        shape = (-1,) + (1,) * (level.dim() - 1)
        return self.offset.view(shape) + self.span.view(shape) * level

    def of(self, pairs: ViewPairs) -> InverseDepths:
        """The ranges of the views whose depth is sought."""
        return replace(self, offset=pairs.own(self.offset), span=pairs.own(self.span))

    def candidates(self) -> Tensor:
        """(V, D) inverse depths."""
        return self.offset[:, None] + self.span[:, None] * torch.linspace(0, 1, self.count)


@dataclass(frozen=True)
class Comparison:
    """Views that are compared on one grid, and the depths that are sought.

    Attributes:
        pairs: of the views.
        terms: of `sweep_coefficients`, for every pair on the grid.
        depths: ranges of all views.
    """

    pairs: ViewPairs
    terms: tuple[Tensor, Tensor]
    depths: InverseDepths

    @classmethod
    def on(cls, maps: Tensor, K_unit: Tensor, pairs: ViewPairs, depths: InverseDepths) -> Comparison:
        """On the grid of maps (…, C, h, w); K_unit (…, 3, 3) is of all views, divided by image width and height."""
        height, width = maps.shape[2:]
        rays = pixel_rays(pixel_intrinsics(pairs.own(K_unit), height, width), height, width)
        return cls(pairs, pairs.sweep_terms(rays, K_unit), depths)

    def at(self, count: int) -> Comparison:
        """The same with so many candidates."""
        return replace(self, depths=replace(self.depths, count=count))

    def read(self, maps: Tensor, inverse_depth: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What sources have at the places of points.

        Args:
            maps: (…, C, h, w) of all views.
            inverse_depth: of the points, (V, D, h, w) or (V, D, 1, 1).

        Returns:
            The maps there (P, C, D, h, w); 1 where a point is in the source's frame, else 0, and its depth in the
            source over that in the reference, (P, D, h, w).
        """
        x, y, ratio = project_sweep(*self.terms, inverse_depth[self.pairs.reference])
        return sample_bilinear(maps[self.pairs.source], x, y), inside_frame(x, y, ratio), ratio


def matched(
    guide: Tensor, views: Comparison, settings: SweepSettings, lead: Tensor | float = 0.0
) -> tuple[Tensor, Tensor]:
    """Costs of every candidate and what semi-global aggregation makes of them, both (V, D, h, w).

    Args:
        guide: (V, 3, h, w) colours.
        views: to compare.
        settings: of costs and paths.
        lead: added to the costs: what is known beforehand.

    Returns:
        The costs; the aggregated costs less their minimum over candidates.
    """
    costs = matching_costs(guide, views, settings) + lead
    paths = path_costs(costs, views.pairs.own(guide))
    return costs, paths - paths.amin(dim=1, keepdim=True)


def settled(paths: Tensor, guide: Tensor, views: Comparison, settings: SweepSettings) -> tuple[Tensor, Tensor]:
    """Level (V, 1, h, w) of the lowest aggregated costs, filled where views disagree, and agreement before filling."""
    return agreed(soft_argmin(paths), guide, views, settings)


def agreed(level: Tensor, guide: Tensor, views: Comparison, settings: SweepSettings) -> tuple[Tensor, Tensor]:
    """Levels (…, 1, h, w) of all views, filled where views disagree, and agreement before filling."""
    agreement = cross_view_agreement(level, views, settings)
    own, colours = views.pairs.own(level), views.pairs.own(guide)
    filled = fill_uncertain(own, agreement, colours, settings.fill_dilations)
    return filled, agreement


def matching_costs(half: Tensor, views: Comparison, settings: SweepSettings) -> Tensor:
    """Photo-consistency (V, D, h, w) of every candidate: 0 is a perfect match.

    Truncated absolute differences of colour and of local contrast (which does not see exposure), averaged over a
    small box and over the sources that have the point in their frame.
    """
    features, pairs = half, views.pairs
    if settings.contrast_weight:
        contrast = local_contrast(half.mean(dim=1, keepdim=True))
        features = torch.cat([half, contrast], dim=1)
    read, seen, _ = views.read(features, views.depths.candidates()[:, :, None, None])  # (P, 3 or 4, D, h, w)
    difference = (read - features[pairs.reference][:, :, None]).abs()
    cost = settings.colour_weight * difference[:, :3].mean(dim=1).clamp_max(COLOUR_LIMIT)
    if settings.contrast_weight:
        cost = cost + settings.contrast_weight * difference[:, 3].clamp_max(CONTRAST_LIMIT)
    cost = box_mean(cost, WINDOW)
    count = pairs.by_view(seen).sum(dim=1)
    mean = pairs.by_view(cost * seen).sum(dim=1) / count.clamp_min(1)
    return torch.where(count > 0, mean, UNSEEN_COST)


def soft_argmin(costs: Tensor) -> Tensor:
    """Level (V, 1, h, w) in [0, 1] of the lowest cost (V, D, h, w), to a fraction of a candidate.

    The softmax-weighted mean of the best candidate and its two neighbours; the rest would pull it to the middle.
    """
    count = costs.shape[1]
    index = torch.arange(count, dtype=costs.dtype)[:, None, None]
    best = costs.argmin(dim=1, keepdim=True).to(costs.dtype)
    weights = torch.exp(SHARPNESS * (costs.amin(dim=1, keepdim=True) - costs)) * ((index - best).abs() < 1.5)
    return (weights * index).sum(dim=1, keepdim=True) / weights.sum(dim=1, keepdim=True) / (count - 1)


def error_in_sources(level: Tensor, views: Comparison, *further: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """How far the points of `level` (V, 1, h, w) lie before what each source sees at their place.

    Returns:
        The distance in candidates (P, 1, h, w), positive in front; 1 where the point is in the source's frame; and
        `further` maps (V, 1, h, w) as the source has them there, (P, n, h, w).
    """
    pairs, depths = views.pairs, views.depths
    inverse_depth = depths.at(level)
    read, seen, ratio = views.read(torch.cat([inverse_depth, *further], dim=1), inverse_depth)
    expected = inverse_depth[pairs.reference] / ratio.clamp_min(BEHIND)
    unit = (depths.span / (depths.count - 1))[pairs.source][:, None, None, None]
    return (expected - read[:, :1, 0]) / unit, seen, read[:, 1:, 0]


def cross_view_agreement(level: Tensor, views: Comparison, settings: SweepSettings) -> Tensor:
    """How well the depth that a source view has at a pixel's place agrees with the pixel's own, (V, 1, h, w) in (0, 1].

    The best source counts. A pixel that no source has in its frame gets `UNSEEN_AGREEMENT`.
    """
    error, seen, _ = error_in_sources(level, views)
    by_view = views.pairs.by_view
    agreement = by_view(torch.exp(-0.5 * (error / settings.consistency).square()) * seen).amax(dim=1)
    anywhere = by_view(seen).amax(dim=1)
    return torch.where(anywhere > 0, agreement, UNSEEN_AGREEMENT).clamp_min(1e-3)


def opacities_from_agreement(level: Tensor, matched: Tensor, views: Comparison, settings: SweepSettings) -> Tensor:
    """Opacity (V, 1, h, w) of a filled level map: high where views agree, low in space that another view sees through.

    Args:
        level: (V, 1, h, w) after filling.
        matched: (V, 1, h, w) agreement before filling, a source's weight as a witness.
        views: every view with every other.
        settings: of consistency.
    """
    by_view = views.pairs.by_view
    error, seen, witness = error_in_sources(level, views, matched)
    in_front = ((error - INTRUSION_FROM) / INTRUSION_RAMP).clamp(0, 1)
    intrusion = by_view(in_front * seen * witness.clamp(LEAST_WITNESS, 1.0)).amax(dim=1)
    agreement = by_view(torch.exp(-0.5 * (error / settings.consistency).square()) * seen).amax(dim=1)
    hidden = by_view((error < 0) * seen).amax(dim=1) * HIDDEN
    anywhere = by_view(seen).amax(dim=1)
    agreement = torch.where(anywhere > 0, torch.maximum(agreement, hidden), UNSEEN)
    return OPACITY * (1 - INTRUSION_SHARE * intrusion) * (1 - AGREEMENT_SHARE * (1 - agreement))


def align_photos(level: Tensor, images: Tensor, views: Comparison, settings: AlignmentSettings) -> Tensor:
    """Refine levels (V, 1, H, W) on the images' own grid by Gauss-Newton steps on the colour difference to the sources.

    Lucas and Kanade 1981 along the epipolar line: the pixels of a box move together, outliers count less.
    """
    pairs, depths = views.pairs, views.depths.of(views.pairs)
    unit = 1 / (depths.count - 1)
    for _ in range(settings.steps):
        reach = REACH * unit
        samples = depths.at(torch.cat([level - reach, level, level + reach], dim=1))
        read, inside, _ = views.read(images, samples)  # (P, 3, 3 samples, H, W)
        seen = inside[:, 1:2]
        slope = (read[:, :, 2] - read[:, :, 0]) / (2 * REACH)  # colour per candidate
        rest = read[:, :, 1] - images[pairs.reference]
        weight = seen / (1 + rest.square().mean(dim=1, keepdim=True) / OUTLIER**2)
        products = torch.cat([(slope * rest).sum(1, keepdim=True), slope.square().sum(1, keepdim=True)], dim=1)
        means = box_mean(products * weight, settings.window)
        if settings.any_exposure:
            parts = box_mean(torch.cat([slope, rest, torch.ones_like(weight)], dim=1) * weight, settings.window)
            mean_slope, mean_rest, mass = parts.split([3, 3, 1], dim=1)
            shared = torch.cat([mean_slope * mean_rest, mean_slope.square()], dim=1).unflatten(1, (2, 3)).sum(dim=2)
            means = means - shared / mass.clamp_min(1e-6)
        sums = pairs.by_view(means).sum(dim=1)
        step = -sums[:, :1] / (sums[:, 1:] + DAMPING)
        level = (level + step.clamp(-LARGEST_STEP, LARGEST_STEP) * unit).clamp(0, 1)
    return level


def double(maps: Tensor) -> Tensor:
    """Maps (V, C, h, w) at twice the resolution, bilinear."""
    return functional.interpolate(maps, scale_factor=2.0, mode="bilinear", align_corners=False)
