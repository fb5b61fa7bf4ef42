"""Multi-view transformer: the features of each view meet those of the other views inside (shifted) windows.

Single head, no biases in the projections. A layer stays in window layout (N, 4, L, C) throughout, N = B·V, since all
but attention is per token. MVSplat and DepthSplat both use it.

A map of h × w tokens is split into 2 × 2 windows of L = hw/4 tokens; every second layer shifts the split by half a
window with wrap-around and masks what only the wrap made neighbours (Liu et al. 2021, "Swin"). A layout is a
permutation of tokens, so that shift and split are one read. Everything here exports with dynamic sizes.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

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
            others: (B·V, M) int64, the views that each view attends to (`cost_volume.all_others`).

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
