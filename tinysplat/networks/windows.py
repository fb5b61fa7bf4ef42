"""Windows of a feature map for attention: layouts, masks and the position code inside a window.

A map of h × w tokens is split into 2 × 2 windows of L = hw/4 tokens; every second layer shifts the split by half a
window with wrap-around and masks what only the wrap made neighbours (Liu et al. 2021, "Swin"). A layout is a
permutation of tokens, so that shift and split are one read. Everything here exports with dynamic sizes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

SPLIT = 2
"""Windows along each side of a map."""

MASKED = -100.0
"""Added to the score of two tokens that may not see each other."""


@dataclass(frozen=True)
class WindowLayout:
    """Where tokens stand in windows.

    Attributes:
        to_windows: (hw,) map position, row by row, of every window slot; windows and their tokens row by row.
        to_map: (hw,) window slot of every map position.
    """

    to_windows: Tensor
    to_map: Tensor

    def split(self, tokens: Tensor) -> Tensor:
        """Map tokens (N, hw, C) to windows (N, 4, L, C)."""
        return tokens.index_select(1, self.to_windows).unflatten(1, (SPLIT * SPLIT, -1))

    def merge(self, windows: Tensor) -> Tensor:
        """Windows (N, 4, L, C) back to map tokens (N, hw, C)."""
        return windows.flatten(1, 2).index_select(1, self.to_map)


def window_layout(height: int, width: int, shifted: bool, device: torch.device) -> WindowLayout:
    """Layout of a height × width map, both multiples of 4; `shifted` moves it up and left by half a window first."""
    rows, columns = (size // SPLIT // 2 if shifted else 0 for size in (height, width))
    source = _wrapped(height, rows, device)[:, None] * width + _wrapped(width, columns, device)[None]
    slots = torch.arange(height * width, device=device).reshape(SPLIT, SPLIT, height // SPLIT, width // SPLIT)
    slots = slots.transpose(1, 2).reshape(height, width)
    back = _wrapped(height, -rows, device)[:, None] * width + _wrapped(width, -columns, device)[None]
    return WindowLayout(_window_order(source), slots.flatten()[back.flatten()])


def _wrapped(size: int, shift: int, device: torch.device) -> Tensor:
    """(i + shift) mod size for i = 0 … size − 1 and |shift| < size; by comparison, as a size is no ONNX divisor."""
    index = torch.arange(size, device=device) + shift
    return index + size * ((index < 0).long() - (index >= size).long())


def _window_order(x: Tensor) -> Tensor:
    """Values per map position (h, w) in the order of window slots (hw,)."""
    height, width = x.shape
    return x.reshape(SPLIT, height // SPLIT, SPLIT, width // SPLIT).transpose(1, 2).flatten()


def shifted_regions(height: int, width: int, device: torch.device) -> Tensor:
    """Number of the region of every slot of the shifted windows (4, L): tokens of one region may see each other.

    The shift cuts rows and columns into three bands each: whole windows, the rest, what wrapped around.
    """

    def bands(size: int) -> Tensor:
        window = size // SPLIT
        position = torch.arange(size, device=device)
        return (position >= size - window).long() + (position >= size - window // 2).long()

    regions = 3 * bands(height)[:, None] + bands(width)[None]
    return _window_order(regions).unflatten(0, (SPLIT * SPLIT, -1))


def attention_mask(queries: Tensor, keys: Tensor) -> Tensor:
    """Scores to add (4, L, L') for regions (4, L) and (4, L'): 0 within a region, `MASKED` across regions."""
    return (queries[:, :, None] != keys[:, None]).float() * MASKED


def regions_of_keys(regions: Tensor, others: int) -> Tensor:
    """Regions (4, M·L) that the released weights meet for the keys of M other views, view by view.

    The reference lays out keys with the view index fastest (key p·M + m is position p of view m) but repeats the mask
    along the key axis, so that key j is masked like position j mod L. For M > 1 the two disagree; the weights were
    trained and are run that way.
    """
    length = regions.shape[-1]
    view, position = (torch.arange(size, device=regions.device) for size in (others, length))
    key = position * others + view[:, None]  # (M, L)
    return regions.index_select(1, key.remainder(torch.full_like(key, length)).flatten())


def position_code(height: int, width: int, channels: int) -> Tensor:
    """Sine code (height · width, channels): half the channels for y, half for x, sine and cosine alternating.

    Angles are 2π r / n over 1-based positions, divided by 10000^(2k / (channels/2)) for pair k.
    """
    half = channels // 2
    frequency = 10000.0 ** (-torch.arange(0, half, 2) / half)  # (half / 2,)

    def code(size: int) -> Tensor:
        position = torch.arange(1, size + 1, dtype=torch.float32)
        angle = (position / (position.max() + 1e-6) * (2 * math.pi))[:, None] * frequency
        return torch.stack([angle.sin(), angle.cos()], dim=-1).flatten(1)  # (size, half)

    y = code(height)[:, None].expand(height, width, half)
    x = code(width)[None].expand(height, width, half)
    return torch.cat([y, x], dim=-1).flatten(0, 1)
