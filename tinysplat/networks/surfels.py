"""Gaussians by construction: from an inverse-depth map and its photo to a layer of per-pixel Gaussians.

Nothing here is learned. Colour goes to SH degree 0, scales follow the pixel's footprint and the slope of depth,
rotations the surface normal, and a coarse second layer stands behind depth edges and beyond the frame.
Values are smooth wherever the depth map is: every plane of the codec is a smooth function of inverse depth.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from tinysplat.transforms import multiply_quats
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.render.project import DILATION

from .aggregation import box_mean, box_minimum
from .geometry import (
    focal_length,
    inside_frame,
    pixel_intrinsics,
    pixel_rays,
    project_sweep,
    rotation_quats,
    sample_bilinear,
    tilt_quats,
    unproject,
)
from .pairs import ViewPairs

MAX_SLOPE = 2.0
"""Bound on |Δz / Δx| of a surface: beyond it the normal of a depth map is noise, and discs would be needles."""

SLOPE_WINDOW = 25
"""Side in pixels of the box that slopes are averaged over: their noise shows in no picture, and costs bits."""

SURFACES = 2.0
"""How many surfaces lie in one another, from as many views, where one is drawn: each hides as much again."""

EQUAL_DEPTH = 2e-4
"""Relative difference of inverse depth that rounding and coding decide: who is in front of whom is not known below."""


@dataclass(frozen=True)
class GaussianLayer:
    """A layer of per-pixel Gaussians in the conventions of `tinysplat_runtime.Gaussians`.

    Attributes:
        means: (V, h, w, 3).
        quats: (V, h, w, 4) wxyz.
        scales: (V, h, w, 3).
        opacities: (V, h, w).
        sh: (V, h, w, 1, 3).
        K: (V, 3, 3) intrinsics in pixels of the layer's own grid.
    """

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    sh: Tensor
    K: Tensor

    def arrays(self) -> tuple[Tensor, ...]:
        """Means (V, H, W, 3), quats (…, 4), scales (…, 3), opacities (V, H, W) and sh (…, B, 3)."""
        return self.means, self.quats, self.scales, self.opacities, self.sh


def surface_slopes(inverse_depth: Tensor, rays: Tensor, K: Tensor) -> Tensor:
    """∂z/∂x and ∂z/∂y of the surface in the camera frame, (V, 2, h, w), bounded by `MAX_SLOPE`.

    On a plane n·X = 1 inverse depth is n·ray, linear in the ray, so n follows from its gradient g along the rays:
    n = (g_x, g_y, ρ − x g_x − y g_y), and the slope is −n_xy / n_z. Differences are central, one-sided at borders.
    """
    padded = functional.pad(inverse_depth, (1, 1, 1, 1), mode="replicate")
    focal = K[:, :, :, None, None]
    gradient_x = (padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2]) * (0.5 * focal[:, 0:1, 0])
    gradient_y = (padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]) * (0.5 * focal[:, 1:2, 1])
    facing = inverse_depth - rays[:, 0:1] * gradient_x - rays[:, 1:2] * gradient_y
    facing = torch.maximum(facing, 0.2 * inverse_depth)  # a visible surface faces the camera
    return (torch.cat([gradient_x, gradient_y], dim=1) / -facing).clamp(-MAX_SLOPE, MAX_SLOPE)


def splat_weights(inverse_depth: Tensor, opacities: Tensor, footprint: float | Tensor) -> Tensor:
    """The share of each of 3 × 3 Gaussians in the pixel between them, drawn from the photo's place, (V, 9, H, W).

    Gaussians hide one another in the order of their depths: on a slope the nearer ones lie before the others like
    shingles, and a picture of them is blurred and moved. Of two at about one depth each hides half.

    Args:
        inverse_depth: (V, 1, H, W).
        opacities: (V, 1, H, W).
        footprint: standard deviation, pixels; one number or (V, 1, H, W).
    """
    squared = footprint * footprint + DILATION + torch.zeros_like(opacities)
    distance = torch.tensor([2.0, 1, 2, 1, 0, 1, 2, 1, 2])[:, None, None]  # squared, of `neighbours`
    alpha = neighbours(opacities) * torch.exp(-0.5 * distance / neighbours(squared))
    dimming = torch.log1p(-alpha)
    near = neighbours(inverse_depth)
    left = []
    for i in range(9):
        here = near[:, i : i + 1]
        before = ((near - here) / (EQUAL_DEPTH * here) + 0.5).clamp(0, 1)
        left.append((dimming * before).sum(dim=1, keepdim=True) - 0.5 * dimming[:, i : i + 1])
    weights = alpha * torch.exp(SURFACES * torch.cat(left, dim=1))
    return weights / weights.sum(dim=1, keepdim=True).clamp_min(1e-6)


def neighbours(maps: Tensor) -> Tensor:
    """The 3 × 3 values about each of (V, 1, h, w), row by row, borders replicated: (V, 9, h, w)."""
    height, width = maps.shape[2:]
    padded = functional.pad(maps, (1, 1, 1, 1), mode="replicate")
    return torch.cat([padded[..., y : y + height, x : x + width] for y in range(3) for x in range(3)], dim=1)


def sharpened(images: Tensor, weights: Tensor, gain: float | Tensor, finer_gain: float | Tensor) -> Tensor:
    """Photos (V, 3, H, W) with what drawing takes from them added, and what it takes from that.

    Van Cittert's iteration (1931) for the colours of which `splat_weights` make the photo; factors may differ from one.
    """

    def lost(maps: Tensor) -> Tensor:
        drawn = [(neighbours(maps[:, c : c + 1]) * weights).sum(dim=1, keepdim=True) for c in range(3)]
        return maps - torch.cat(drawn, dim=1)

    detail = lost(images)
    return images + gain * detail + finer_gain * lost(detail)


def pixel_layer(
    images: Tensor, K_unit: Tensor, c2w: Tensor, inverse_depth: Tensor, opacities: Tensor, footprint: float | Tensor
) -> GaussianLayer:
    """One Gaussian per pixel on the surface, its mean on the ray through the pixel's centre.

    A disc: its third axis is the surface normal; the first two are the camera's x and y axes turned along, and as
    long as the pixel's footprint on the surface.

    Args:
        images: (V, 3, H, W) RGB in [0, 1].
        K_unit: (V, 3, 3) intrinsics divided by image width and height.
        c2w: (V, 4, 4).
        inverse_depth: (V, 1, H, W), > 0.
        opacities: (V, 1, H, W) in [0, 1].
        footprint: standard deviation on a frontal surface, pixels; one number or (V, 1, H, W).
    """
    height, width = images.shape[2:]
    K = pixel_intrinsics(K_unit, height, width)
    rays = pixel_rays(K, height, width)
    depth = 1 / inverse_depth
    slopes = box_mean(surface_slopes(inverse_depth, rays, K), SLOPE_WINDOW)
    frontal = footprint * depth / focal_length(K)[:, None, None, None]
    scales = torch.cat([frontal * torch.sqrt(1 + slopes * slopes), frontal], dim=1)
    tilt = tilt_quats(slopes[:, 0], slopes[:, 1])
    quats = multiply_quats(rotation_quats(c2w[:, :3, :3])[:, None, None], tilt)
    return GaussianLayer(
        unproject(rays, depth, c2w).permute(0, 2, 3, 1),
        quats,
        scales.permute(0, 2, 3, 1),
        opacities[:, 0],
        _degree_zero(images),
        K,
    )


CELL, RING = 4, 24
"""Side of a grid cell of the second layer, pixels of the photo, and cells added beyond each side of the frame."""

REACH = 5
"""Side of the neighbourhood, in cells (odd), whose farthest depth a cell takes."""

RECEDE, RING_RECEDE = 0.9, 0.65
"""Factors on inverse depth that keep the backdrop behind the surface, and beyond the frame."""

FARTHEST = 0.4
"""Smallest inverse depth of the second layer, relative to that of the far plane."""

WIDTH, OPACITY = 2.4, 0.8
"""Standard deviation, pixels of the photo, and opacity of every Gaussian in the second layer."""

HIDDEN_RECEDE = 0.85
"""Factor on the inverse depth that another view sees, < 1: a cell stands behind that."""


@dataclass(frozen=True)
class CoarseChanges:
    """What a learned network changes in the second layer: maps (V, n, h, w) on its grid, ring included.

    Attributes:
        inverse_depth: factor, n = 1.
        width: factor, n = 1.
        opacity: added to the logit, n = 1.
        colour: added, n = 3.
    """

    inverse_depth: Tensor
    width: Tensor
    opacity: Tensor
    colour: Tensor


def coarse_layer(
    images: Tensor,
    K_unit: Tensor,
    c2w: Tensor,
    inverse_depth: Tensor,
    far: Tensor,
    pairs: ViewPairs,
    changes: CoarseChanges | None = None,
) -> GaussianLayer:
    """One wide, round Gaussian per cell at the farthest depth nearby, continued past the frame.

    Args:
        images: (V, 3, H, W) RGB in [0, 1]; H and W are multiples of the cell.
        K_unit: (V, 3, 3) intrinsics divided by image width and height.
        c2w: (V, 4, 4).
        inverse_depth: (V, 1, H, W), > 0.
        far: (V,) far plane.
        pairs: every view with every other.
        changes: to the construction, or None.

    Returns:
        A layer of (H / cell + 2·ring, W / cell + 2·ring) Gaussians with its own K.
    """
    height, width = images.shape[2] // CELL, images.shape[3] // CELL
    colours = functional.avg_pool2d(images, CELL)
    shallow = functional.max_pool2d(-pairs.own(inverse_depth), CELL)
    farthest = box_minimum(-shallow, REACH) * RECEDE
    inside = torch.ones_like(farthest)
    ring_factor = functional.pad(inside, (RING,) * 4, value=RING_RECEDE)
    behind = functional.pad(farthest, (RING,) * 4, mode="replicate") * ring_factor
    least = (FARTHEST / far)[:, None, None, None]
    colours = functional.pad(colours, (RING,) * 4, mode="replicate")
    opacity: Tensor | float = OPACITY
    width_px: Tensor | float = WIDTH
    if changes is not None:
        behind, colours = behind * changes.inverse_depth, colours + changes.colour
        logit = math.log(OPACITY / (1 - OPACITY))
        opacity, width_px = torch.sigmoid(logit + changes.opacity), WIDTH * changes.width

    shift = torch.tensor([[0.0, 0.0, RING], [0.0, 0.0, RING], [0.0, 0.0, 0.0]])
    K = pixel_intrinsics(pairs.own(K_unit), height, width) + shift
    rays = pixel_rays(K, height + 2 * RING, width + 2 * RING)
    terms = pairs.sweep_terms(rays, K_unit)
    behind = torch.maximum(behind, least)
    behind = torch.maximum(_behind_others(behind, terms, inverse_depth, pairs), least)
    covered = (ring_factor < 1) * _seen_elsewhere(behind, terms, pairs)
    depth = 1 / behind
    scale = width_px / CELL * depth / focal_length(K)[:, None, None, None]  # (V, 1, h, w)
    grid = (-1, height + 2 * RING, width + 2 * RING)
    return GaussianLayer(
        unproject(rays, depth, pairs.own(c2w)).permute(0, 2, 3, 1),
        rotation_quats(pairs.own(c2w)[:, :3, :3])[:, None, None].expand(*grid, 4),
        scale.permute(0, 2, 3, 1).expand(*grid, 3),
        (opacity * (1 - covered))[:, 0],
        _degree_zero(colours),
        K,
    )


def _behind_others(behind: Tensor, terms: tuple[Tensor, Tensor], inverse_depth: Tensor, pairs: ViewPairs) -> Tensor:
    """Push cells (V, 1, h, w) that stand in space which another view sees through behind what it sees there."""
    own = behind[pairs.reference]
    x, y, ratio = project_sweep(*terms, own)
    there = sample_bilinear(inverse_depth[pairs.source], x, y)[:, 0] * ratio * HIDDEN_RECEDE
    allowed = torch.where(inside_frame(x, y, ratio) > 0, there, own)
    return torch.minimum(behind, pairs.by_view(allowed).amin(dim=1))


def _seen_elsewhere(behind: Tensor, terms: tuple[Tensor, Tensor], pairs: ViewPairs) -> Tensor:
    """1 − 1/S where another view has a cell (V, 1, h, w) in its frame, S being the number of other views, else 0.

    Of many views the pixels of one cover what another's ring would only hide; of two, each needs the other's ring.
    """
    x, y, ratio = project_sweep(*terms, behind[pairs.reference])
    return pairs.by_view(inside_frame(x, y, ratio)).amax(dim=1) * (1 - 1 / pairs.sources)


def _degree_zero(colours: Tensor) -> Tensor:
    """SH coefficients (V, h, w, 1, 3) of colours (V, 3, h, w)."""
    return ((colours - 0.5) / C0).permute(0, 2, 3, 1)[:, :, :, None]
