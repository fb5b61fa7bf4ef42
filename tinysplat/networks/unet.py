"""The small U-Nets that regularise cost volumes and depth; constant width, attention across views at the bottom.

After the U-Net of latent diffusion (Rombach et al. 2022) without time embedding: one residual block per level going
down, two going up, and at the coarsest level attention over the tokens of all views of a scene together, in heads of
32 channels and without position code. MVSplat normalises after convolutions, DepthSplat before.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

HEAD_CHANNELS = 32
GROUPS = 8


def _conv3x3(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)


class ResidualUnit(nn.Module):
    """Two 3×3 convolutions with GroupNorm and SiLU after (`post_norm`) or before each, plus a shortcut."""

    def __init__(self, inputs: int, outputs: int, post_norm: bool) -> None:
        super().__init__()
        if post_norm:
            self.in_layers = nn.Sequential(_conv3x3(inputs, outputs), nn.GroupNorm(GROUPS, outputs), nn.SiLU())
            self.out_layers = nn.Sequential(_conv3x3(outputs, outputs), nn.GroupNorm(GROUPS, outputs), nn.SiLU())
        else:
            self.in_layers = nn.Sequential(nn.GroupNorm(GROUPS, inputs), nn.SiLU(), _conv3x3(inputs, outputs))
            self.out_layers = nn.Sequential(
                nn.GroupNorm(GROUPS, outputs), nn.SiLU(), nn.Identity(), _conv3x3(outputs, outputs)
            )
        self.skip_connection = nn.Identity() if inputs == outputs else nn.Conv2d(inputs, outputs, 1)

    def forward(self, x: Tensor, views: int) -> Tensor:
        """(N, inputs, h, w) to (N, outputs, h, w)."""
        return self.skip_connection(x) + self.out_layers(self.in_layers(x))


class CrossViewAttention(nn.Module):
    """Self-attention over all V·h·w tokens of a scene; the norm's statistics stay per view."""

    def __init__(self, channels: int, post_norm: bool) -> None:
        super().__init__()
        self.post_norm = post_norm
        self.heads = channels // HEAD_CHANNELS
        self.qkv = nn.Conv1d(channels, 3 * channels, 1)
        self.proj_out = nn.Conv1d(channels, channels, 1)
        self.norm = nn.GroupNorm(GROUPS, channels)

    def forward(self, x: Tensor, views: int) -> Tensor:
        """(B·V, C, h, w) to the same shape."""
        tokens = x.flatten(2)  # (B·V, C, hw)
        message = self._attend(tokens if self.post_norm else self.norm(tokens), views)
        return (tokens + (self.norm(message) if self.post_norm else message)).view_as(x)

    def _attend(self, tokens: Tensor, views: int) -> Tensor:
        batch, channels, length = tokens.shape
        qkv = self.qkv(tokens).transpose(1, 2)  # (B·V, hw, 3C)
        qkv = qkv.reshape(batch // views, views * length, self.heads, 3, HEAD_CHANNELS)
        q, k, v = qkv.permute(3, 0, 2, 1, 4).unbind(0)  # each (B, heads, V·hw, 32)
        out = functional.scaled_dot_product_attention(q, k, v).transpose(1, 2)
        return self.proj_out(out.reshape(batch, length, channels).transpose(1, 2))


class Downsample(nn.Module):
    """3×3 convolution with stride 2."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.op = nn.Conv2d(channels, channels, 3, stride=2, padding=1)

    def forward(self, x: Tensor, views: int) -> Tensor:
        """(N, C, h, w) to (N, C, h/2, w/2)."""
        return self.op(x)


class Upsample(nn.Module):
    """Nearest neighbour to twice the size, then a 3×3 convolution."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = _conv3x3(channels, channels)

    def forward(self, x: Tensor, views: int) -> Tensor:
        """(N, C, h, w) to (N, C, 2h, 2w)."""
        return self.conv(functional.interpolate(x, scale_factor=2, mode="nearest"))


class Stem(nn.Conv2d):
    """The first convolution, with the blocks' signature."""

    def forward(self, x: Tensor, views: int) -> Tensor:  # type: ignore[override]
        """(N, C, h, w) to (N, C', h, w)."""
        return super().forward(x)


class Chain(nn.ModuleList):
    """Blocks applied in order, each told the number of views."""

    def forward(self, x: Tensor, views: int) -> Tensor:
        """(B·V, C, h, w)."""
        for block in self:
            x = block(x, views)
        return x


class UNet(nn.Module):
    """U-Net of constant width.

    Args:
        channels: width of every level, a multiple of 32.
        levels: resolutions, so that the coarsest is 1 / 2^(levels − 1).
        post_norm: GroupNorm after convolutions and attention (MVSplat) or before them (DepthSplat).
    """

    def __init__(self, channels: int, levels: int, post_norm: bool) -> None:
        super().__init__()

        def level_blocks(inputs: int, level: int) -> list[nn.Module]:
            unit: list[nn.Module] = [ResidualUnit(inputs, channels, post_norm)]
            return [*unit, CrossViewAttention(channels, post_norm)] if level == levels - 1 else unit

        down = [Chain([Stem(channels, channels, 3, padding=1)])]
        for level in range(levels):
            down.append(Chain(level_blocks(channels, level)))
            if level < levels - 1:
                down.append(Chain([Downsample(channels)]))
        up = []
        for level in reversed(range(levels)):
            up.append(Chain(level_blocks(2 * channels, level)))
            last = [Upsample(channels)] if level > 0 else []
            up.append(Chain([*level_blocks(2 * channels, level), *last]))
        self.input_blocks = nn.ModuleList(down)
        self.middle_block = nn.ModuleDict(
            {"0": ResidualUnit(channels, channels, post_norm), "2": ResidualUnit(channels, channels, post_norm)}
        )
        self.output_blocks = nn.ModuleList(up)
        norm, conv = nn.GroupNorm(GROUPS, channels), _conv3x3(channels, channels)
        self.out = nn.Sequential(conv, norm, nn.SiLU()) if post_norm else nn.Sequential(norm, nn.SiLU(), conv)

    def forward(self, x: Tensor, views: int) -> Tensor:
        """(B·V, channels, h, w) to the same shape, h and w multiples of 2^(levels − 1)."""
        skips = []
        for block in self.input_blocks:
            x = block(x, views)
            skips.append(x)
        for block in self.middle_block.values():
            x = block(x, views)
        for block in self.output_blocks:
            x = block(torch.cat([x, skips.pop()], dim=1), views)
        return self.out(x)


class RefinementNet(nn.Sequential):
    """Layers in order, of which the U-Nets are told the number of views."""

    def forward(self, x: Tensor, views: int) -> Tensor:  # type: ignore[override]
        """(B·V, C, h, w) to (B·V, C', h, w)."""
        for layer in self:
            x = layer(x, views) if isinstance(layer, UNet) else layer(x)
        return x
