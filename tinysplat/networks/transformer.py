"""Multi-view transformer: the features of each view meet those of the other views inside (shifted) windows.

Single head, no biases in the projections. A layer stays in window layout (N, 4, L, C) throughout, N = B·V, since all
but attention is per token. MVSplat and DepthSplat both use it.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from .windows import SPLIT, attention_mask, position_code, regions_of_keys, shifted_regions, window_layout

LAYERS = 6


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
            nn.Linear(2 * channels, 8 * channels, bias=False), nn.GELU(), nn.Linear(8 * channels, channels, bias=False)
        )
        self.norm2 = nn.LayerNorm(channels)

    def forward(self, x: Tensor, sources: Tensor, others: Tensor, mask: Tensor | None) -> Tensor:
        """Window tokens x and sources (B·V, 4, L, C), others (B·V, M), mask (4, L, M·L) or None."""

        def of_others(tokens: Tensor) -> Tensor:  # (B·V, 4, M·L, C), view by view
            read = tokens.index_select(0, others.flatten()).unflatten(0, others.shape)
            return read.transpose(1, 2).flatten(2, 3)

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
        """Window tokens (B·V, 4, L, C), others (B·V, M)."""
        return self.cross_attn_ffn(self.self_attn(x, mask), x, others, cross_mask)


class MultiViewTransformer(nn.Module):
    """Position code within each window, then the layers, every second one with shifted windows."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(TransformerLayer(channels) for _ in range(LAYERS))

    def forward(self, features: Tensor, others: Tensor) -> Tensor:
        """Exchange features between views.

        Args:
            features: (B·V, C, h, w), h and w multiples of 4.
            others: (B·V, M) int64, the views that each view attends to (`views.py`).

        Returns:
            (B·V, C, h, w).
        """
        _, channels, height, width = features.shape
        layouts = [window_layout(height, width, shifted, features.device) for shifted in (False, True)]
        regions = shifted_regions(height, width, features.device)
        of_keys = regions_of_keys(regions, others.shape[-1])
        masks = [(None, None), tuple(attention_mask(regions, keys).to(features) for keys in (regions, of_keys))]
        code = position_code(height // SPLIT, width // SPLIT, channels).to(features)
        tokens = features.flatten(2).transpose(1, 2)  # (B·V, hw, C)
        tokens = layouts[0].merge(layouts[0].split(tokens) + code)
        for index, layer in enumerate(self.layers):
            layout = layouts[index % 2]
            tokens = layout.merge(layer(layout.split(tokens), others, *masks[index % 2]))
        return tokens.transpose(1, 2).unflatten(2, (height, width))
