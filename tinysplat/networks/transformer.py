"""Multi-view transformer with (shifted) windows: the features of each view meet those of the other views.

Single head, no biases. Attention runs inside a 2 × 2 split of the map; odd layers shift the split by half a window and
mask the parts of a window that only wrap-around made neighbours (Liu et al. 2021, "Swin"). A layer stays in window
layout (N, 4, L, C) throughout, N = B·V, L = hw/4, since all but attention is per token. Both networks use it.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from .views import gather_views

SPLIT = 2
"""Windows along each side of a map."""

MASKED = -100.0
"""Added to the score of two tokens that may not see each other."""


def split_windows(x: Tensor) -> Tensor:
    """Maps (N, h, w, C) to windows (N, 4, L, C), windows and their tokens row by row."""
    n, h, w, channels = x.shape
    x = x.reshape(n, SPLIT, h // SPLIT, SPLIT, w // SPLIT, channels)
    return x.transpose(2, 3).reshape(n, SPLIT * SPLIT, (h // SPLIT) * (w // SPLIT), channels)


def merge_windows(x: Tensor, height: int, width: int) -> Tensor:
    """Windows (N, 4, L, C) back to maps (N, height, width, C)."""
    n, _, _, channels = x.shape
    x = x.reshape(n, SPLIT, SPLIT, height // SPLIT, width // SPLIT, channels)
    return x.transpose(2, 3).reshape(n, height, width, channels)


def window_shift(height: int, width: int) -> tuple[int, int]:
    """By how many rows and columns odd layers shift: half a window."""
    return height // SPLIT // 2, width // SPLIT // 2


def shifted_window_mask(height: int, width: int) -> Tensor:
    """(4, L, L) scores to add after a shift: 0 within a region, `MASKED` across regions.

    The shift cuts rows and columns into three bands each: whole windows, the rest, what wrapped around.
    """

    def bands(size: int) -> Tensor:
        window = size // SPLIT
        position = torch.arange(size)
        return (position >= size - window).float() + (position >= size - window // 2).float()

    regions = 3 * bands(height)[:, None] + bands(width)[None]  # (height, width)
    regions = split_windows(regions[None, :, :, None])[0, :, :, 0]  # (4, L)
    return (regions[:, :, None] != regions[:, None, :]).float() * MASKED


def cross_attention_mask(mask: Tensor, others: int) -> Tensor:
    """The mask (4, L, L) as the released weights meet it with M other views: (4, L, M·L).

    The reference lays out keys with the view index fastest (key p·M + m is position p of view m) but repeats the mask
    along the key axis, so that key j meets column j mod L. For M > 1 the two disagree; the weights were trained and are
    run that way. Keys stand view by view here, hence the lookup.
    """
    length = mask.shape[-1]
    view, position = torch.arange(others)[:, None], torch.arange(length)[None]
    return mask[:, :, ((position * others + view) % length).flatten()]


def position_code(height: int, width: int, channels: int) -> Tensor:
    """Sine code (height · width, channels): half the channels for y, half for x, sine and cosine alternating.

    Angles are 2π r / n over 1-based positions, divided by 10000^(2k / (channels/2)) for pair k.
    """
    half = channels // 2
    frequency = 10000.0 ** (-torch.arange(0, half, 2) / half)  # (half / 2,)

    def code(size: int) -> Tensor:
        angle = (torch.arange(size) + 1)[:, None] * (2 * math.pi / (size + 1e-6)) * frequency
        return torch.stack([angle.sin(), angle.cos()], dim=-1).flatten(1)  # (size, half)

    y = code(height)[:, None].expand(height, width, half)
    x = code(width)[None].expand(height, width, half)
    return torch.cat([y, x], dim=-1).flatten(0, 1)


class WindowAttention(nn.Module):
    """softmax(q kᵀ / √C + mask) v and an output projection with LayerNorm; no biases in the projections."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.q_proj = nn.Linear(channels, channels, bias=False)
        self.k_proj = nn.Linear(channels, channels, bias=False)
        self.v_proj = nn.Linear(channels, channels, bias=False)
        self.merge = nn.Linear(channels, channels, bias=False)
        self.norm1 = nn.LayerNorm(channels)

    def attend(self, q: Tensor, k: Tensor, v: Tensor, mask: Tensor | None) -> Tensor:
        """Queries (N, 4, L, C), keys and values (N, 4, L', C), mask (4, L, L'): message (N, 4, L, C)."""
        return self.norm1(self.merge(functional.scaled_dot_product_attention(q, k, v, attn_mask=mask)))


class SelfAttention(WindowAttention):
    """x + message from the own view; no feed-forward part."""

    def forward(self, x: Tensor, mask: Tensor | None) -> Tensor:
        """Window tokens (N, 4, L, C), mask (4, L, L) or None."""
        return x + self.attend(self.q_proj(x), self.k_proj(x), self.v_proj(x), mask)


class CrossAttention(WindowAttention):
    """x + feed-forward of x and the message from the other views."""

    def __init__(self, channels: int) -> None:
        super().__init__(channels)
        self.mlp = nn.Sequential(
            nn.Linear(2 * channels, 8 * channels, bias=False),
            nn.GELU(),
            nn.Linear(8 * channels, channels, bias=False),
        )
        self.norm2 = nn.LayerNorm(channels)

    def forward(self, x: Tensor, sources: Tensor, others: Tensor, mask: Tensor | None) -> Tensor:
        """Window tokens x and sources (B·V, 4, L, C), others (B, V, M), mask (4, L, M·L) or None."""

        def of_others(tokens: Tensor) -> Tensor:  # (B·V, 4, M·L, C), view by view
            read = gather_views(tokens.unflatten(0, others.shape[:2]), others)
            return read.flatten(0, 1).transpose(1, 2).flatten(2, 3)

        keys, values = of_others(self.k_proj(sources)), of_others(self.v_proj(sources))
        message = self.attend(self.q_proj(x), keys, values, mask)
        return x + self.norm2(self.mlp(torch.cat([x, message], dim=-1)))


class TransformerLayer(nn.Module):
    """Self-attention, then cross-attention to the other views *as they entered the layer*."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.self_attn = SelfAttention(channels)
        self.cross_attn_ffn = CrossAttention(channels)

    def forward(self, x: Tensor, others: Tensor, mask: Tensor | None, cross_mask: Tensor | None) -> Tensor:
        """Window tokens (B·V, 4, L, C), others (B, V, M)."""
        return self.cross_attn_ffn(self.self_attn(x, mask), x, others, cross_mask)


class MultiViewTransformer(nn.Module):
    """Position code within each window, then the layers, every second one with shifted windows."""

    def __init__(self, channels: int = 128, depth: int = 6) -> None:
        super().__init__()
        self.layers = nn.ModuleList(TransformerLayer(channels) for _ in range(depth))

    def forward(self, features: Tensor, others: Tensor) -> Tensor:
        """Exchange features between views.

        Args:
            features: (B·V, C, h, w), h and w multiples of 4.
            others: (B, V, M) int64, the views that each view attends to.

        Returns:
            (B·V, C, h, w).
        """
        _, channels, height, width = features.shape
        rows, columns = window_shift(height, width)
        mask = shifted_window_mask(height, width).to(features)
        cross_mask = cross_attention_mask(mask, others.shape[-1])
        maps = features.permute(0, 2, 3, 1)
        for index, layer in enumerate(self.layers):
            if index % 2:
                tokens = split_windows(maps.roll((-rows, -columns), (1, 2)))
                maps = merge_windows(layer(tokens, others, mask, cross_mask), height, width)
                maps = maps.roll((rows, columns), (1, 2))
            else:
                tokens = split_windows(maps)
                if index == 0:
                    tokens = tokens + position_code(height // SPLIT, width // SPLIT, channels).to(tokens)
                maps = merge_windows(layer(tokens, others, None, None), height, width)
        return maps.permute(0, 3, 1, 2)
