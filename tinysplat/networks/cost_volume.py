"""Plane-sweep cost volume: how well features of other views match, for each pixel and depth candidate.

score(pixel, d) = mean over the other views j of ⟨f_i(pixel), f_j(where the pixel at depth d lands in j)⟩ / √C, read
bilinearly with zeros outside. Because the read is linear and the product bilinear, the correlation of the pixel with
*all* positions of view j is computed first, as one matrix product, and then read at the D landing points: the same
numbers as warping C-channel features, at 1/C of the reads. Memory is bounded by doing so in bands of rows.

Two traits of the released networks are kept: the reference view's K serves both views, and points behind the other
camera are not masked, only their z is clamped. Positions are integer pixel indices, without the half-pixel offset.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from .algebra import invert_intrinsics, relative_poses
from .views import gather_views

MIN_Z = 1e-3
"""Least z of a projected point, scene units."""

BANDS = 4
"""Row bands of the correlation; h is a multiple of it for every accepted image size."""


def inverse_depth_candidates(near: Tensor, far: Tensor, count: int) -> Tensor:
    """Candidates (…, count) uniform in inverse depth from 1/far to 1/near, for near and far (…)."""
    t = torch.linspace(0, 1, count, dtype=near.dtype, device=near.device)
    return 1 / far[..., None] + t * (1 / near - 1 / far)[..., None]


def landing_points(K: Tensor, c2w: Tensor, others: Tensor, disparities: Tensor, size: tuple[int, int]) -> Tensor:
    """Where the pixels of each view land in its other views.

    Args:
        K: (B, V, 3, 3) in pixels of the feature map.
        c2w: (B, V, 4, 4).
        others: (B, V, M).
        disparities: (B, V, P or 1, D) inverse depth per pixel (P = hw, row by row) and candidate.
        size: h, w of the feature map.

    Returns:
        (B, V, M, P, D, 2) x and y in [−1, 1] from the first to the last pixel centre.
    """
    height, width = size
    rotation, translation = relative_poses(c2w[:, :, None], gather_views(c2w, others))  # (B, V, M, 3, 3), (…, 3, 1)
    rows = torch.arange(height, dtype=K.dtype, device=K.device)[:, None].expand(height, width)
    columns = torch.arange(width, dtype=K.dtype, device=K.device)[None].expand(height, width)
    pixels = torch.stack([columns, rows, torch.ones_like(rows)]).flatten(1)  # (3, P)
    K = K[:, :, None]
    turned = (K @ rotation @ invert_intrinsics(K)) @ pixels  # (B, V, M, 3, P)
    shift = K @ translation  # (B, V, M, 3, 1)
    depths = 1 / disparities[:, :, None]  # (B, V, 1, P or 1, D)
    x, y, z = (turned[:, :, :, i, :, None] * depths + shift[:, :, :, i, :, None] for i in range(3))
    z = z.clamp_min(MIN_Z)
    return torch.stack([2 * (x / z) / (width - 1) - 1, 2 * (y / z) / (height - 1) - 1], dim=-1)


def match_scores(features: Tensor, K: Tensor, c2w: Tensor, others: Tensor, disparities: Tensor) -> Tensor:
    """Cost volume of every view.

    Args:
        features: (B, V, C, h, w).
        K: (B, V, 3, 3) in pixels of the feature map.
        c2w: (B, V, 4, 4) camera to world, rigid.
        others: (B, V, M) views that each view is swept against.
        disparities: (B, V, D, h, w) or (B, V, D, 1, 1) inverse depth candidates.

    Returns:
        (B·V, D, h, w) scores, larger where the views agree.
    """
    scenes, views, channels, height, width = features.shape
    count, pairs = others.shape[-1], scenes * views * others.shape[-1]
    grid = landing_points(K, c2w, others, disparities.flatten(3).transpose(2, 3), (height, width))
    reference = features.flatten(3).transpose(2, 3)[:, :, None] / math.sqrt(channels)  # (B, V, 1, P, C)
    targets = gather_views(features.flatten(3), others)  # (B, V, M, C, P)
    scores = []
    banded = zip(*(x.unflatten(3, (BANDS, -1)).unbind(3) for x in (reference, grid)), strict=True)
    for pixels, points in banded:
        correlation = (pixels @ targets).reshape(-1, 1, height, width)  # a one-channel image per pixel and pair
        points = points.reshape(correlation.shape[0], -1, 1, 2)
        read = functional.grid_sample(correlation, points, mode="bilinear", padding_mode="zeros", align_corners=True)
        scores.append(read.reshape(pairs, -1, points.shape[1]))
    volume = torch.cat(scores, dim=1).reshape(scenes * views, count, height * width, -1).mean(dim=1)
    return volume.transpose(1, 2).reshape(scenes * views, -1, height, width)
