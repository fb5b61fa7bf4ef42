"""DPT-style fusion head (Ranftl et al. 2021): four monocular maps and the matching branch's maps to full resolution.

DepthSplat uses it twice: to upsample depth (it returns a residual of inverse depth) and to make per-pixel features.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import torch
from torch import Tensor, nn
from torch.nn import functional

from .dinov2 import resize

LEVELS = 4
Recipe: TypeAlias = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]
"""Names of the maps that are concatenated at 1/2, 1/4 and 1/8; "mono" stands for the head's own map of that level."""


class ResidualConvUnit(nn.Module):
    """x + conv(relu(conv(relu(x))))."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels, channels, 3, padding=1)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """(N, C, h, w)."""
        return x + self.conv2(functional.relu(self.conv1(functional.relu(x))))


class FusionBlock(nn.Module):
    """Adds a skip to the path from below, refines, resizes to the next finer level and projects."""

    def __init__(self, channels: int, has_skip: bool) -> None:
        super().__init__()
        if has_skip:
            self.resConfUnit1 = ResidualConvUnit(channels)
        self.resConfUnit2 = ResidualConvUnit(channels)
        self.out_conv = nn.Conv2d(channels, channels, 1)

    def forward(self, skip: Tensor, path: Tensor | None, size: Sequence[int]) -> Tensor:
        """(N, C, h, w) to (N, C, *size); without a path the skip is the path."""
        x = skip if path is None else path + self.resConfUnit1(skip)
        return self.out_conv(resize(self.resConfUnit2(x), size))


class FusionLayers(nn.Module):
    """Level convolutions, fusion blocks and, for a residual, the output convolutions."""

    def __init__(self, widths: Sequence[int], channels: int, has_output: bool) -> None:
        super().__init__()
        self.refinenet1: FusionBlock
        for level, width in enumerate(widths, start=1):
            setattr(self, f"layer{level}_rn", nn.Conv2d(width, channels, 3, padding=1, bias=False))
            setattr(self, f"refinenet{level}", FusionBlock(channels, has_skip=level < LEVELS))
        self.output_conv = (
            nn.Sequential(
                nn.Conv2d(channels, channels // 2, 3, padding=1, padding_mode="replicate"),
                nn.GELU(),
                nn.Conv2d(channels // 2, 16, 3, padding=1, padding_mode="replicate"),
                nn.GELU(),
                nn.Conv2d(16, 1, 1),
            )
            if has_output
            else nn.Identity()
        )


class DPTHead(nn.Module):
    """The head.

    Args:
        inputs: channels of the monocular maps.
        widths: channels of the four levels.
        features: channels of the fused map.
        recipe: what is concatenated at the three finest levels, in this order.
        channels_of: channels of every named map of the recipe but "mono".
        has_output: end in one channel (the residual) rather than in `features` channels.
    """

    def __init__(
        self,
        inputs: int,
        widths: tuple[int, int, int, int],
        features: int,
        recipe: Recipe,
        channels_of: Mapping[str, int],
        has_output: bool,
    ) -> None:
        super().__init__()
        self.recipe = recipe
        self.projects = nn.ModuleList(nn.Conv2d(inputs, width, 1) for width in widths)
        self.resize_layers = nn.ModuleList(
            [
                nn.ConvTranspose2d(widths[0], widths[0], 4, stride=4),
                nn.ConvTranspose2d(widths[1], widths[1], 2, stride=2),
                nn.Identity(),
                nn.Conv2d(widths[3], widths[3], 3, stride=2, padding=1),
            ]
        )
        self.concat_projects = nn.ModuleList(
            nn.Conv2d(sum(width if name == "mono" else channels_of[name] for name in names), width, 1)
            for names, width in zip(recipe, widths, strict=False)
        )
        self.scratch = FusionLayers(widths, features, has_output)

    def forward(self, mono: Sequence[Tensor], maps: Mapping[str, Tensor]) -> Tensor:
        """Fuse.

        Args:
            mono: four maps (N, inputs, H/8, W/8).
            maps: the recipe's other maps by name, each at the resolution of its level.

        Returns:
            (N, features or 1, H, W).
        """
        levels = [
            resize_layer(project(x))
            for x, project, resize_layer in zip(mono, self.projects, self.resize_layers, strict=True)
        ]
        for index, (names, project) in enumerate(zip(self.recipe, self.concat_projects, strict=True)):
            parts = [levels[index] if name == "mono" else maps[name] for name in names]
            levels[index] = project(torch.cat(parts, dim=1))
        skips = [getattr(self.scratch, f"layer{level}_rn")(x) for level, x in enumerate(levels, start=1)]
        path: Tensor | None = None
        for level in range(LEVELS, 1, -1):
            path = getattr(self.scratch, f"refinenet{level}")(skips[level - 1], path, skips[level - 2].shape[-2:])
        height, width = skips[0].shape[-2:]
        return self.scratch.output_conv(self.scratch.refinenet1(skips[0], path, (2 * height, 2 * width)))
