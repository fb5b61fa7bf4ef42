"""DINOv2 vision transformer (Oquab et al. 2023), patch 14, without registers: DepthSplat's monocular backbone."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

PATCH = 14
HEAD_CHANNELS = 64
TRAINED_GRID = 37
"""The position embedding is a 37 × 37 grid, that of a 518 × 518 image."""

GRID_OFFSET = 0.1
"""Added to the grid size when the embedding is resized, as in the reference: the step is 37 / (n + 0.1), not 37 / n."""

NORM_EPSILON = 1e-6
CUBIC = -0.75
"""Coefficient of the cubic convolution kernel that torch and ONNX share."""


@dataclass(frozen=True)
class ViTSize:
    """Width, number of blocks, and the blocks whose tokens are handed out."""

    channels: int
    blocks: int
    taken: tuple[int, int, int, int]


SIZES = {
    "S": ViTSize(384, 12, (2, 5, 8, 11)),
    "B": ViTSize(768, 12, (2, 5, 8, 11)),
    "L": ViTSize(1024, 24, (4, 11, 17, 23)),
}


def _cubic_weights(t: Tensor) -> Tensor:
    """Weights (…, 4) of the samples at −1, 0, 1, 2 for a position at fraction t (…)."""

    def near(x: Tensor) -> Tensor:
        return ((CUBIC + 2) * x - (CUBIC + 3)) * x * x + 1

    def far(x: Tensor) -> Tensor:
        return ((CUBIC * x - 5 * CUBIC) * x + 8 * CUBIC) * x - 4 * CUBIC

    return torch.stack([far(t + 1), near(t), near(1 - t), far(2 - t)], dim=-1)


def cubic_resize_matrix(outputs: int, scale: Tensor) -> Tensor:
    """Matrix (outputs, 37) of bicubic resizing of `TRAINED_GRID` along one axis: half-pixel centres, borders repeated.

    Args:
        outputs: number of output samples.
        scale: () output samples per input sample.
    """
    position = (torch.arange(outputs, dtype=scale.dtype, device=scale.device) + 0.5) / scale - 0.5
    first = position.floor()
    weights = _cubic_weights(position - first)  # (outputs, 4)
    taps = torch.arange(-1, 3, dtype=scale.dtype, device=scale.device)
    sources = (first[:, None] + taps).clamp(0, TRAINED_GRID - 1)  # (outputs, 4)
    hits = sources[..., None] == torch.arange(TRAINED_GRID, dtype=scale.dtype, device=scale.device)  # (outputs, 4, 37)
    return (weights[..., None] * hits).sum(dim=1)


class PatchEmbedding(nn.Module):
    """14 × 14 convolution with stride 14."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.proj = nn.Conv2d(3, channels, PATCH, stride=PATCH)


class Attention(nn.Module):
    """Multi-head self-attention."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.qkv = nn.Linear(channels, 3 * channels)
        self.proj = nn.Linear(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        """Tokens (N, T, C)."""
        qkv = self.qkv(x).unflatten(-1, (3, -1, HEAD_CHANNELS))  # (N, T, 3, heads, 64)
        q, k, v = qkv.permute(2, 0, 3, 1, 4).unbind(0)
        return self.proj(functional.scaled_dot_product_attention(q, k, v).transpose(1, 2).flatten(2))


class FeedForward(nn.Module):
    """Two linear layers with GELU between."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(channels, 4 * channels)
        self.fc2 = nn.Linear(4 * channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        """Tokens (N, T, C)."""
        return self.fc2(functional.gelu(self.fc1(x)))


class LayerScale(nn.Module):
    """A learned factor per channel."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.gamma = nn.Parameter(torch.ones(channels))

    def forward(self, x: Tensor) -> Tensor:
        """Tokens (N, T, C)."""
        return x * self.gamma


class TransformerBlock(nn.Module):
    """Pre-norm attention and feed-forward with LayerScale."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(channels, NORM_EPSILON)
        self.attn = Attention(channels)
        self.ls1 = LayerScale(channels)
        self.norm2 = nn.LayerNorm(channels, NORM_EPSILON)
        self.mlp = FeedForward(channels)
        self.ls2 = LayerScale(channels)

    def forward(self, x: Tensor) -> Tensor:
        """Tokens (N, T, C)."""
        x = x + self.ls1(self.attn(self.norm1(x)))
        return x + self.ls2(self.mlp(self.norm2(x)))


class DINOv2(nn.Module):
    """The backbone, returning four intermediate maps."""

    def __init__(self, size: ViTSize) -> None:
        super().__init__()
        self.size = size
        self.cls_token = nn.Parameter(torch.zeros(1, 1, size.channels))
        self.pos_embed = nn.Parameter(torch.zeros(1, 1 + TRAINED_GRID**2, size.channels))
        self.patch_embed = PatchEmbedding(size.channels)
        self.blocks = nn.ModuleList(TransformerBlock(size.channels) for _ in range(size.blocks))
        self.norm = nn.LayerNorm(size.channels, NORM_EPSILON)

    def position_embedding(self, rows: int, columns: int) -> Tensor:
        """Embedding (1, 1 + rows · columns, C): the trained one, resized unless the grid is the trained one.

        As two matrix products, which serve any size in one graph and are exact when nothing is to be resized.
        """
        grid = self.pos_embed[0, 1:].unflatten(0, (TRAINED_GRID, TRAINED_GRID))  # (37, 37, C)
        count = torch.stack([torch.scalar_tensor(rows), torch.scalar_tensor(columns)]).to(grid)
        offset = GRID_OFFSET * (count != TRAINED_GRID).any().to(grid)
        scale = (count + offset) / TRAINED_GRID
        vertical, horizontal = (
            cubic_resize_matrix(size, scale[axis]).to(grid) for axis, size in enumerate((rows, columns))
        )
        resized = torch.matmul(horizontal, (vertical @ grid.flatten(1)).unflatten(1, (TRAINED_GRID, -1)))
        return torch.cat([self.pos_embed[:, :1], resized.flatten(0, 1)[None]], dim=1)

    def forward(self, images: Tensor) -> list[Tensor]:
        """Normalised images (N, 3, 14 r, 14 c) to four maps (N, C, r, c), each through the final norm."""
        patches = self.patch_embed.proj(images)
        rows, columns = patches.shape[-2:]
        tokens = torch.cat([self.cls_token.expand(patches.shape[0], -1, -1), patches.flatten(2).transpose(1, 2)], dim=1)
        tokens = tokens + self.position_embedding(rows, columns)
        maps = []
        for index, block in enumerate(self.blocks):
            tokens = block(tokens)
            if index in self.size.taken:
                maps.append(self.norm(tokens)[:, 1:].transpose(1, 2).unflatten(2, (rows, columns)))
        return maps


def monocular_features(vit: DINOv2, images: Tensor, reduction: int) -> list[Tensor]:
    """Normalised images (N, 3, H, W) of any size to four maps (N, C, H/reduction, W/reduction).

    The image is resized to the patch grid and the maps to the wanted one, bilinear with corners aligned.
    """
    height, width = images.shape[-2:]
    patched = resize(images, (height // PATCH * PATCH, width // PATCH * PATCH))
    return [resize(tokens, (height // reduction, width // reduction)) for tokens in vit(patched)]


def resize(x: Tensor, size: Sequence[int]) -> Tensor:
    """Maps (N, C, h, w) to (N, C, *size), bilinear with corners aligned."""
    return functional.interpolate(x, size=(size[0], size[1]), mode="bilinear", align_corners=True)
