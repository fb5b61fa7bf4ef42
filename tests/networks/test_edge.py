"""The network `edge` in torch: at first it is its analytic part, it stays within its bounds, and its size is kept."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, trace
from torch import Tensor, nn

from tinysplat.networks.edge import OPACITY_CAP, OUTPUT_NAMES, Edge
from tinysplat.networks.sweep import Sweep
from tinysplat.rasteriser import PinholeCamera, render
from tinysplat_runtime.gaussian.sh import C0


def inputs(views: int, height: int, width: int) -> tuple[Tensor, ...]:
    scene = trace(views, height, width)
    return (
        torch.from_numpy(np.ascontiguousarray(scene.images.transpose(0, 3, 1, 2), np.float32)),
        torch.from_numpy(np.float32([camera.K_unit for camera in scene.cameras])),
        torch.from_numpy(np.float32([camera.c2w for camera in scene.cameras])),
        torch.full((views,), NEAR),
        torch.full((views,), FAR),
    )


def disturbed(amount: float) -> Edge:
    """A network whose weights, those that start at zero too, have noise added."""
    torch.manual_seed(0)
    network = Edge()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(amount * torch.randn_like(parameter))
    return network


@lru_cache(maxsize=2)
def disturbed_outputs(amount: float) -> tuple[tuple[Tensor, ...], dict[str, Tensor]]:
    """What a network of such weights is given, and its outputs."""
    given = inputs(2, 48, 64)
    with torch.no_grad():
        return given, dict(zip(OUTPUT_NAMES, disturbed(amount)(*given), strict=True))


def test_whatever_the_weights_are_outputs_stay_within_their_bounds() -> None:
    _, outputs = disturbed_outputs(0.3)
    for name, values in outputs.items():
        assert torch.isfinite(values).all(), name
    assert float(outputs["opacities"].min()) >= 0 and float(outputs["opacities"].max()) <= OPACITY_CAP
    assert float(outputs["layer1_opacities"].max()) <= 1
    assert float(outputs["depth"].min()) >= NEAR * (1 - 1e-5) and float(outputs["depth"].max()) <= FAR * (1 + 1e-5)
    assert float(outputs["scales"].min()) > 0 and float(outputs["layer1_scales"].min()) > 0


def footprints(outputs: dict[str, Tensor], K: Tensor) -> Tensor:
    """The smaller of the first two standard deviations of the first layer, pixels of the photo, (V, H, W)."""
    height, width = outputs["depth"].shape[1:]
    focal = (K[:, 0, 0] * width * K[:, 1, 1] * height).sqrt()[:, None, None]
    return outputs["scales"][..., :2].amin(dim=-1) * focal / outputs["depth"]


@pytest.mark.parametrize("amount", [0.3, 0.0])
def test_whatever_the_weights_are_a_gaussian_is_as_wide_as_closes_a_surface(amount: float) -> None:
    given, outputs = disturbed_outputs(amount)
    assert float(footprints(outputs, given[1]).min()) >= 0.4 - 1e-4


@pytest.mark.parametrize("network", [Edge(), Sweep()])
def test_drawn_four_times_as_large_a_surface_has_no_holes(network: nn.Module) -> None:
    scene = trace(2, 96, 128)
    given = inputs(2, 96, 128)
    with torch.no_grad():
        outputs = network(*given)
        camera = scene.cameras[0]
        K = torch.tensor(camera.K, dtype=torch.float32)
        K[:2] *= 4
        # a part of the picture that both views show
        K[:2, 2] -= torch.tensor([4 * 48.0, 4 * 32.0])
        place = PinholeCamera(K, torch.tensor(camera.c2w, dtype=torch.float32), 128, 128)
        layers = [
            torch.cat([a.reshape(-1, *a.shape[3:]), b.reshape(-1, *b.shape[3:])])
            for a, b in zip(outputs[:5], outputs[5:10], strict=True)
        ]
        means, quats, scales, opacities, sh = layers
        _, left = render(means, quats, scales, opacities, (0.5 + C0 * sh[:, 0]).clamp_min(0), place)
    assert float(left.max()) <= 0.02
