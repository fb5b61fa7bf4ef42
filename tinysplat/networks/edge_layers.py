"""Layers of `edge`: a refiner of costs, a U-Net, and upsampling, with zero at the end of whatever adds to something.

Convex upsampling is after Teed and Deng, "RAFT" (2020), section 3.3.
"""

from itertools import pairwise
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from .sweep import double

_Layer = TypeVar("_Layer", nn.Conv2d, nn.Conv3d)


class Residual(nn.Module):
    """x + two convolutions, the second of which starts at zero; ReLU at the end."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first, self.second = convolution(channels, channels), zero(convolution(channels, channels))

    def forward(self, x: Tensor) -> Tensor:
        """(V, C, h, w) to the same."""
        return functional.relu(x + self.second(functional.relu(self.first(x))))


class CostRefiner(nn.Module):
    """Additions to the logits over candidates, from the volume of costs: every candidate is treated alike.

    Three-dimensional convolutions over candidates, rows and columns; what the picture looks like is added to the first
    of them for all candidates at once.
    """

    def __init__(self, volumes: int, maps: int, channels: int) -> None:
        super().__init__()
        self.entry = convolution3(volumes, channels)
        self.context = convolution(maps, channels)
        self.mix = convolution3(channels, channels)
        self.out = zero(nn.Conv3d(channels, 1, 1))

    def forward(self, volumes: Tensor, maps: Tensor) -> Tensor:
        """(V, n, D, h, w) and (V, m, h, w) to (V, D, h, w)."""
        x = functional.relu(self.entry(volumes) + self.context(maps)[:, :, None])
        return self.out(x + functional.relu(self.mix(x)))[:, 0]


class FeatureUNet(nn.Module):
    """Features at the input's resolution and at half of it, with context from an eighth."""

    def __init__(self, inputs: int, widths: tuple[int, int, int, int]) -> None:
        super().__init__()
        self.entry = convolution(inputs, widths[0])
        self.down = nn.ModuleList(convolution(a, b, stride=2) for a, b in pairwise(widths))
        self.encode = nn.ModuleList(Residual(width) for width in widths)
        self.lateral = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(widths))
        self.decode = nn.ModuleList(Residual(width) for width in widths[:-1])

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """(V, C, h, w), sides multiples of 8, to (V, widths[0], h, w) and (V, widths[1], h / 2, w / 2)."""
        levels = [self.encode[0](functional.relu(self.entry(x)))]
        for down, encode in zip(self.down, self.encode[1:], strict=True):
            levels.append(encode(functional.relu(down(levels[-1]))))
        coarse = levels.pop()
        decoded = [coarse]
        for lateral, decode in zip(reversed(self.lateral), reversed(self.decode), strict=True):
            decoded.append(decode(functional.relu(levels.pop() + double(lateral(decoded[-1])))))
        return decoded[-1], decoded[-2]


def convolution(inputs: int, outputs: int, stride: int = 1, dilation: int = 1) -> nn.Conv2d:
    """A 3 × 3 convolution for ReLU features, initialised after He et al. 2015."""
    layer = nn.Conv2d(inputs, outputs, 3, stride, padding=dilation, dilation=dilation)
    nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return layer


def convolution3(inputs: int, outputs: int) -> nn.Conv3d:
    """A 3 × 3 × 3 convolution, initialised as `convolution`."""
    layer = nn.Conv3d(inputs, outputs, 3, padding=1)
    nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return layer


def zero(layer: _Layer) -> _Layer:
    """The layer with nothing in it yet: what it adds begins at zero."""
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return layer


def convex_upsampling(values: Tensor, logits: Tensor) -> Tensor:
    """Twice the resolution: every new pixel a convex combination of the 3 × 3 old ones around it.

    Args:
        values: (V, 1, h, w).
        logits: (V, 36, h, w), nine for each of the four new pixels: index 4·neighbour + new pixel.

    Returns:
        (V, 1, 2h, 2w).
    """
    height, width = values.shape[2:]
    padded = functional.pad(values, (1, 1, 1, 1), mode="replicate")
    around = [padded[:, :, i : i + height, j : j + width] for i in range(3) for j in range(3)]
    weights = torch.softmax(logits.unflatten(1, (9, 4)), dim=1)
    return functional.pixel_shuffle((weights * torch.stack(around, dim=1)).sum(dim=1), 2)


def bilinear_logits() -> Tensor:
    """Logits (1, 36, 1, 1) with which `convex_upsampling` is bilinear interpolation, but for a floor of 1e-3."""
    along = torch.tensor([[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]])  # (new, old)
    weights = torch.einsum("ai,bj->ijab", along, along).reshape(1, 36, 1, 1)
    return torch.log(weights.clamp_min(1e-3))
