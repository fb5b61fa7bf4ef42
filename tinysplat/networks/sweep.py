"""`sweep`: a feedforward network without learned weights.

A plane sweep after Collins 1996 whose every stage is a fixed graph: photo-consistency over inverse-depth candidates,
semi-global aggregation, soft-argmin, cross-view consistency, filling, and Gaussians by construction. It makes the
product useful on any scene at once and is the baseline that a learned network has to beat.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from .aggregation import box_mean, fill_uncertain, local_contrast, path_costs
from .geometry import (
    BEHIND,
    inside_frame,
    pixel_intrinsics,
    pixel_rays,
    project_sweep,
    relative_pose,
    sample_bilinear,
    sweep_coefficients,
)
from .surfels import CoarseSettings, coarse_layer, pixel_layer

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


@dataclass(frozen=True)
class SweepSettings:
    """What the sweep is made of; costs are of the order of one.

    Attributes:
        candidates: inverse depths from far to near, uniform.
        colour_weight: weight of the mean absolute colour difference.
        colour_limit: that difference is cut here.
        contrast_weight: weight of the absolute difference of local contrast.
        contrast_limit: that difference is cut here.
        contrast_window: side of the window of local contrast, half-resolution pixels.
        unseen_cost: cost of a candidate that no other view has in its frame.
        window: side of the box that the cost is averaged over before the paths.
        step, jump, edge: of `aggregation.path_costs`.
        sharpness: inverse temperature of the soft-argmin.
        consistency: standard deviation of the cross-view error that still counts as agreement, candidates.
        unseen_confidence: confidence of pixels that no other view has in its frame.
        fill_edge, fill_dilations: of `aggregation.fill_uncertain`.
        footprint: standard deviation of a Gaussian on a frontal surface, pixels.
        opacity_low, opacity_high: opacity at confidence 0 and 1.
        coarse: the second layer.
    """

    candidates: int = 56
    colour_weight: float = 3.0
    colour_limit: float = 0.12
    contrast_weight: float = 0.15
    contrast_limit: float = 1.0
    contrast_window: int = 9
    unseen_cost: float = 0.35
    window: int = 3
    step: float = 0.1
    jump: float = 0.6
    edge: float = 12.0
    sharpness: float = 12.0
    consistency: float = 1.5
    unseen_confidence: float = 0.3
    fill_edge: float = 12.0
    fill_dilations: tuple[int, ...] = (1, 2, 4, 8, 8, 8)
    footprint: float = 0.3
    opacity_low: float = 0.3
    opacity_high: float = 0.95
    coarse: CoarseSettings = field(default_factory=CoarseSettings)


class Sweep(nn.Module):
    """Posed photos to two layers of Gaussians."""

    def __init__(self, settings: SweepSettings | None = None) -> None:
        super().__init__()
        self.settings = settings or SweepSettings()

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
        settings = self.settings
        pairs = ViewPairs.build(c2w, K)
        sweep = InverseDepths(1 / far, 1 / near - 1 / far, settings.candidates)
        half = functional.avg_pool2d(images, 2)
        rays = pixel_rays(pixel_intrinsics(K, half.shape[2], half.shape[3]), half.shape[2], half.shape[3])
        terms = sweep_coefficients(rays[pairs.reference], K[pairs.source], pairs.rotation, pairs.translation)

        costs = matching_costs(half, terms, pairs, sweep, settings)
        costs = path_costs(costs, half, step=settings.step, jump=settings.jump, edge=settings.edge)
        level = soft_argmin(costs, settings.sharpness)  # (V, 1, h, w) in [0, 1] from far to near
        confidence = cross_view_confidence(level, terms, pairs, sweep, settings)
        level = fill_uncertain(level, confidence, half, edge=settings.fill_edge, dilations=settings.fill_dilations)

        level, confidence = _double(level), _double(confidence)
        inverse_depth = sweep.at(level)
        opacities = settings.opacity_low + (settings.opacity_high - settings.opacity_low) * confidence
        surface = pixel_layer(images, K, c2w, inverse_depth, opacities, settings.footprint)
        coarse = coarse_layer(images, K, c2w, inverse_depth, far, settings.coarse)
        return *surface.arrays(), *coarse.arrays(), coarse.K, 1 / inverse_depth[:, 0]


@dataclass(frozen=True)
class ViewPairs:
    """Which views are compared: every view with its nearest others, as P = V·S pairs.

    Attributes:
        reference: (P,) int64 views whose depth is sought.
        source: (P,) int64 views that they are compared with.
        rotation, translation: (P, 3, 3), (P, 3) from reference to source frame.
        sources: S, the number of sources of a view.
    """

    reference: Tensor
    source: Tensor
    rotation: Tensor
    translation: Tensor
    sources: int

    @classmethod
    def build(cls, c2w: Tensor, K: Tensor) -> ViewPairs:
        """Pair each view with its nearest one or two others."""
        views = c2w.shape[0]
        sources = 2 - 2 // views  # one of two views, else two
        centres = c2w[:, :3, 3]
        distance = (centres[:, None] - centres[None]).square().sum(dim=-1)
        itself = torch.eye(views, dtype=distance.dtype)
        chosen = torch.topk(distance + itself * 3e38, sources, dim=1, largest=False).indices  # (V, S)
        reference = torch.arange(views)[:, None].expand_as(chosen).reshape(-1)
        source = chosen.reshape(-1)
        return cls(reference, source, *relative_pose(c2w[reference], c2w[source]), sources)

    def by_view(self, values: Tensor) -> Tensor:
        """Values (P, …) of pairs as (V, S, …)."""
        return values.unflatten(0, (-1, self.sources))


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

    def candidates(self) -> Tensor:
        """(V, D) inverse depths."""
        return self.offset[:, None] + self.span[:, None] * torch.linspace(0, 1, self.count)


def matching_costs(
    half: Tensor, terms: tuple[Tensor, Tensor], pairs: ViewPairs, sweep: InverseDepths, settings: SweepSettings
) -> Tensor:
    """Photo-consistency (V, D, h, w) of every candidate: 0 is a perfect match.

    Truncated absolute differences of colour and of local contrast (which does not see exposure), averaged over a
    small box and over the sources that have the point in their frame.
    """
    gray = half.mean(dim=1, keepdim=True)
    features = torch.cat([half, local_contrast(gray, settings.contrast_window, floor=0.03)], dim=1)
    candidates = sweep.candidates()[pairs.reference][:, :, None, None]
    x, y, ratio = project_sweep(*terms, candidates)
    read = sample_bilinear(features[pairs.source], x, y)  # (P, 4, D, h, w)
    difference = (read - features[pairs.reference][:, :, None]).abs()
    colour = difference[:, :3].mean(dim=1).clamp_max(settings.colour_limit)
    contrast = difference[:, 3].clamp_max(settings.contrast_limit)
    cost = box_mean(settings.colour_weight * colour + settings.contrast_weight * contrast, settings.window)
    seen = inside_frame(x, y, ratio)
    count = pairs.by_view(seen).sum(dim=1)
    mean = pairs.by_view(cost * seen).sum(dim=1) / count.clamp_min(1)
    return torch.where(count > 0, mean, settings.unseen_cost)


def soft_argmin(costs: Tensor, sharpness: float) -> Tensor:
    """Level (V, 1, h, w) in [0, 1] of the lowest cost (V, D, h, w), to a fraction of a candidate.

    The softmax-weighted mean of the best candidate and its two neighbours; the rest would pull it to the middle.
    """
    count = costs.shape[1]
    index = torch.arange(count, dtype=costs.dtype)[:, None, None]
    best = costs.argmin(dim=1, keepdim=True).to(costs.dtype)
    weights = torch.exp(sharpness * (costs.amin(dim=1, keepdim=True) - costs)) * ((index - best).abs() < 1.5)
    return (weights * index).sum(dim=1, keepdim=True) / weights.sum(dim=1, keepdim=True) / (count - 1)


def cross_view_confidence(
    level: Tensor, terms: tuple[Tensor, Tensor], pairs: ViewPairs, sweep: InverseDepths, settings: SweepSettings
) -> Tensor:
    """How well the depth that a source view has at a pixel's place agrees with the pixel's own, (V, 1, h, w) in (0, 1].

    The best source counts. A pixel that no source has in its frame gets `unseen_confidence`.
    """
    inverse_depth = sweep.at(level)
    x, y, ratio = project_sweep(*terms, inverse_depth[pairs.reference])
    there = sample_bilinear(inverse_depth[pairs.source], x, y)[:, 0]  # (P, 1, h, w)
    expected = inverse_depth[pairs.reference] / ratio.clamp_min(BEHIND)
    unit = (sweep.span / (sweep.count - 1))[pairs.source][:, None, None, None]
    error = (there - expected) / (unit * settings.consistency)
    seen = inside_frame(x, y, ratio)
    agreement = pairs.by_view(torch.exp(-0.5 * error * error) * seen).amax(dim=1)
    anywhere = pairs.by_view(seen).amax(dim=1)
    return torch.where(anywhere > 0, agreement, settings.unseen_confidence).clamp_min(1e-3)


def _double(maps: Tensor) -> Tensor:
    return functional.interpolate(maps, scale_factor=2.0, mode="bilinear", align_corners=False)
