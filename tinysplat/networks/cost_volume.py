"""Plane-sweep cost volume: how well features of other views match, for each pixel and depth candidate.

score(pixel, d) = mean over the other views j of ⟨f_i(pixel), f_j(where the pixel at depth d lands in j)⟩ / √C, read
bilinearly with zeros outside. Because the read is linear and the product bilinear, the correlation of the pixel with
*all* positions of view j is computed first, as one matrix product, and then read at the D landing points: the same
numbers as warping C-channel features, at 1/C of the reads. Memory is bounded by doing so in bands of rows.

Two traits of the released networks are kept: the reference view's K serves both views, and points behind the other
camera are not masked, only their z is clamped. Positions are integer pixel indices, without the half-pixel offset.

Tensors per view are (B·V, …), the views of a scene next to each other. A list of other views is an int64 tensor
(B·V, M) that indexes this batch: the M views of its scene that each view attends to and is swept against.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from .geometry import invert_intrinsics, relative_pose


def all_others(c2w: Tensor) -> Tensor:
    """Every other view of the scene in increasing order: (B·V, V − 1) from c2w (B, V, 4, 4)."""
    scenes, views = c2w.shape[:2]
    own = torch.arange(views, device=c2w.device)[:, None]
    other = torch.arange(views - 1, device=c2w.device)[None]
    return _in_batch((other + (other >= own).long()).expand(scenes, views, views - 1), views)


def nearest_others(c2w: Tensor, count: int) -> Tensor:
    """The `count` other views whose camera centres are nearest, or all others where there are no more than `count`.

    Nearest first by Euclidean distance, but all others in increasing order. Equal distances stand as the sort leaves
    them. The distance is a norm of differences, as ONNX has no cdist.

    Args:
        c2w: (B, V, 4, 4).
        count: views wanted.

    Returns:
        (B·V, min(count, V − 1)).
    """
    views = c2w.shape[1]
    centres = c2w[..., :3, 3]
    distances = (centres[:, :, None] - centres[:, None]).norm(dim=-1)  # (B, V, V)
    index = torch.arange(views, dtype=c2w.dtype, device=c2w.device)
    keys = torch.where(index.max() > count, distances, index)
    keys = keys.masked_fill(index[:, None] == index, -1)  # the view itself comes first and is left out
    return _in_batch(keys.argsort(dim=-1)[..., 1:].narrow(-1, 0, torch.sym_min(views - 1, count)), views)


def _in_batch(others: Tensor, views: int) -> Tensor:
    first = torch.arange(others.shape[0], device=others.device)[:, None, None] * views
    return (others + first).flatten(0, 1)


MIN_Z = 1e-3
"""Least z of a projected point, scene units."""

BANDS = 4
"""Row bands of the correlation; h is a multiple of it for every accepted image size."""


def inverse_depth_candidates(near: Tensor, far: Tensor, count: int) -> Tensor:
    """Candidates (…, count) uniform in inverse depth from 1/far to 1/near, for near and far (…)."""
    t = torch.linspace(0, 1, count, dtype=near.dtype, device=near.device)
    return 1 / far[..., None] + t * (1 / near - 1 / far)[..., None]


def landing_points(K: Tensor, c2w: Tensor, c2w_other: Tensor, disparities: Tensor, size: Sequence[int]) -> Tensor:
    """Where the pixels of views land in other views, for N pairs of views.

    Args:
        K: (N, 3, 3) in pixels of the feature map.
        c2w, c2w_other: (N, 4, 4).
        disparities: (N, P or 1, D) inverse depth per pixel (P = hw, row by row) and candidate.
        size: h, w of the feature map.

    Returns:
        (N, P, D, 2) x and y in [−1, 1] from the first to the last pixel centre.
    """
    height, width = size
    rotation, translation = relative_pose(c2w, c2w_other)
    rows = torch.arange(height, dtype=K.dtype, device=K.device)[:, None].expand(height, width)
    columns = torch.arange(width, dtype=K.dtype, device=K.device)[None].expand(height, width)
    pixels = torch.stack([columns, rows, torch.ones_like(rows)]).flatten(1)  # (3, P)
    turned = (K @ rotation @ invert_intrinsics(K)) @ pixels  # (N, 3, P)
    shift = K @ translation[..., None]  # (N, 3, 1)
    depths = 1 / disparities
    x, y, z = (turned[:, i, :, None] * depths + shift[:, i, :, None] for i in range(3))  # (N, P, D)
    z = z.clamp_min(MIN_Z)
    return torch.stack([2 * (x / z) / (width - 1) - 1, 2 * (y / z) / (height - 1) - 1], dim=-1)


def match_scores(features: Tensor, K: Tensor, c2w: Tensor, others: Tensor, disparities: Tensor) -> Tensor:
    """Cost volume of every view.

    Args:
        features: (B·V, C, h, w).
        K: (B·V, 3, 3) in pixels of the feature map.
        c2w: (B·V, 4, 4) camera to world, rigid.
        others: (B·V, M) views that each view is swept against (`all_others`, `nearest_others`).
        disparities: (B·V, D, h, w) or (B·V, D, 1, 1) inverse depth candidates.

    Returns:
        (B·V, D, h, w) scores, larger where the views agree.
    """
    batch, channels, height, width = features.shape
    count = others.shape[1]
    own = torch.arange(batch, device=others.device)[:, None].expand(batch, count).flatten()  # (N,), N = B·V·M
    other = others.flatten()
    candidates = disparities.flatten(2).transpose(1, 2)[own]  # (N, P or 1, D)
    grid = landing_points(K[own], c2w[own], c2w[other], candidates, (height, width))
    flat = features.flatten(2)  # (B·V, C, P)
    reference, targets = flat.transpose(1, 2)[own] / math.sqrt(channels), flat[other]
    scores = []
    for pixels, points in zip(*(x.unflatten(1, (BANDS, -1)).unbind(1) for x in (reference, grid)), strict=True):
        correlation = torch.bmm(pixels, targets).flatten(0, 1)  # (N·P/4, P): one image per pixel of the band
        images, points = correlation.unflatten(1, (1, height, width)), points.flatten(0, 1)[:, :, None]
        read = functional.grid_sample(images, points, mode="bilinear", padding_mode="zeros", align_corners=True)
        scores.append(read.reshape(own.shape[0], -1, disparities.shape[1]))
    volume = torch.cat(scores, dim=1).unflatten(0, (batch, count)).mean(dim=1)  # (B·V, P, D)
    return volume.transpose(1, 2).unflatten(2, (height, width))
