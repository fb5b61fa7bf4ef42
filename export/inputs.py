"""What graphs of the role `network` take: names, dynamic axes, and an example."""

import torch
from torch import Tensor

INPUT_AXES: dict[str, dict[int, str]] = {
    "images": {0: "V", 2: "H", 3: "W"},
    "K": {0: "V"},
    "c2w": {0: "V"},
    "near": {0: "V"},
    "far": {0: "V"},
}
"""Inputs of the role `network` and their dynamic axes."""

INPUT_RANGES = {
    "images": "(V, 3, H, W) RGB in [0, 1]",
    "K": "(V, 3, 3) divided by image width and height",
    "c2w": "(V, 4, 4) OpenCV axes, relative to the mean camera centre",
    "near": "(V,) z > 0, scene units",
    "far": "(V,) z > near, scene units",
}
"""Their units and ranges, which are part of the metadata that every network shares."""


def example_inputs(views: int, height: int, width: int) -> dict[str, Tensor]:
    """A textured plane at z = 3 seen by cameras side by side, one unit apart in all."""
    row, column = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    focal = float(width)
    position = torch.linspace(-0.5, 0.5, views)
    x = (column - width / 2) / focal * 3 + position[:, None, None]  # (V, H, W) on the plane
    y = ((row - height / 2) / focal * 3).expand_as(x)
    waves = [torch.sin(7 * x + 3 * y + c) * torch.cos(5 * y - 2 * x * c) for c in range(3)]
    c2w = torch.eye(4).repeat(views, 1, 1)
    c2w[:, 0, 3] = position
    return {
        "images": 0.5 + 0.4 * torch.stack(waves, dim=1),
        "K": torch.tensor([[1.0, 0.0, 0.5], [0.0, width / height, 0.5], [0.0, 0.0, 1.0]]).repeat(views, 1, 1),
        "c2w": c2w,
        "near": torch.full((views,), 1.5),
        "far": torch.full((views,), 8.0),
    }
