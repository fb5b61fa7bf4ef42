"""Compositing as torch operations, for any device: lists per tile, padded, a group of tiles at a time.

Slower than `kernels` on a CPU, as every splat of a tile's list meets every pixel of the tile; gradients are autograd's.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from tinysplat_runtime.render.composite import ALPHA_MAX, TRANSMITTANCE_MIN
from tinysplat_runtime.render.prepare import ALPHA_MIN

TILE = 8
"""Side of a tile, pixels."""

GROUP_VALUES = 1 << 23
"""Alphas (tile, splat, pixel) that are in memory at a time."""


def tile_lists(bounds: Tensor, rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """Which splats touch which tiles.

    Args:
        bounds: (n, 4) int64 first and last column, first and last row of tiles of splats in depth order.
        rows, columns: of tiles.

    Returns:
        Positions in `bounds`, tile by tile and rising within each, and the length of each tile's part (rows·columns,).
    """
    width = bounds[:, 1] - bounds[:, 0] + 1
    counts = width * (bounds[:, 3] - bounds[:, 2] + 1)
    splat = torch.repeat_interleave(torch.arange(len(bounds), device=bounds.device), counts)
    starts = torch.cumsum(counts, 0) - counts
    within = torch.arange(len(splat), device=bounds.device) - starts[splat]
    row = bounds[splat, 2] + torch.div(within, width[splat], rounding_mode="floor")
    tile = row * columns + bounds[splat, 0] + within % width[splat]
    by_tile = torch.argsort(tile, stable=True)
    return splat[by_tile], torch.bincount(tile, minlength=rows * columns)


def composite_in_tiles(records: Tensor, half_extents: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Blend splats front to back.

    Args:
        records: (n, 9) nearest first: x, y, conic A, B, C, opacity, red, green, blue.
        half_extents: (n, 2) of the footprints, pixels.
        height, width: of the picture.

    Returns:
        The picture (H, W, 3) before black, and the transmittance (H, W).
    """
    rows, columns = -(-height // TILE), -(-width // TILE)
    centres = records[:, :2].detach()
    last = records.new_tensor([columns - 1, rows - 1])
    low = torch.minimum(((centres - half_extents) / TILE).floor().clamp_min(0), last)
    high = torch.minimum(((centres + half_extents) / TILE).floor().clamp_min(0), last)
    bounds = torch.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], dim=1).long()
    splats, lengths = tile_lists(bounds, rows, columns)
    starts = torch.cumsum(lengths, 0) - lengths
    blank = torch.cat([records, records.new_tensor([[0, 0, 1, 0, 1, 0, 0, 0, 0]])])  # a splat that never shows
    by_length = torch.argsort(lengths)
    found = records.new_zeros(rows * columns, TILE * TILE, 4)
    first = 0
    while first < len(by_length):
        group = _next_group(by_length[first:], lengths)
        longest = int(lengths[group[-1]])
        place = torch.arange(longest, device=records.device)
        inside = place < lengths[group, None]
        at = torch.where(inside, splats[(starts[group, None] + place).clamp_max(len(splats) - 1)], len(records))
        row, column = torch.div(group, columns, rounding_mode="floor"), group % columns
        corner = torch.stack([column, row], dim=1) * TILE
        found = found.index_put((group,), checkpoint(_blend, blank, at, corner, use_reentrant=False))
        first += len(group)
    picture = found.view(rows, columns, TILE, TILE, 4).transpose(1, 2).reshape(rows * TILE, columns * TILE, 4)
    picture = picture[:height, :width]
    return picture[..., :3], picture[..., 3]


def _next_group(tiles: Tensor, lengths: Tensor) -> Tensor:
    """As many of the tiles, whose lists grow longer, as fit into `GROUP_VALUES`; at least one."""
    values = lengths[tiles] * TILE * TILE * torch.arange(1, len(tiles) + 1, device=tiles.device)
    return tiles[: max(int((values <= GROUP_VALUES).sum()), 1)]


def _blend(records: Tensor, at: Tensor, corner: Tensor) -> Tensor:
    """Colour and transmittance (t, pixels, 4) of tiles with lists `at` (t, k) and first pixels `corner` (t, 2)."""
    offset = torch.arange(TILE, device=at.device) + 0.5
    chosen = records[at]  # (t, k, 9)
    dx = (corner[:, :1, None] + offset - chosen[..., :1])[:, :, None, :]  # (t, k, 1, TILE)
    dy = (corner[:, 1:, None] + offset - chosen[..., 1:2])[..., None]
    a, b, c, opacity = (chosen[..., i, None, None] for i in range(2, 6))
    alpha = (opacity * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)).clamp_max(float(ALPHA_MAX))
    alpha = (alpha * (alpha >= ALPHA_MIN)).flatten(2)
    after = torch.cumprod(1 - alpha, dim=1)
    kept = after >= float(TRANSMITTANCE_MIN)
    before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=1)
    colour = torch.einsum("tkp,tkc->tpc", alpha * before * kept, chosen[..., 6:])
    left = torch.prod(torch.where(kept, 1 - alpha, torch.ones_like(alpha)), dim=1)
    return torch.cat([colour, left[..., None]], dim=2)
