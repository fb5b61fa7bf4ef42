"""The network `edge` in torch: at first it is its analytic part, it stays within its bounds, and its size is kept."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, trace
from torch import Tensor, nn
from torch.nn import functional

from tinysplat.networks.edge import OPACITY_CAP, OUTPUT_NAMES, Edge
from tinysplat.networks.edge_analysis import expected_level
from tinysplat.networks.edge_layers import convex_upsampling
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


def test_the_refiner_has_no_liking_for_a_depth() -> None:
    refiner = disturbed(0.1).refiner
    volumes, maps = torch.zeros(1, 3, 16, 8, 8), torch.rand(1, 6, 8, 8)
    volumes[:, :, 5:8] = torch.rand(1, 3, 3, 8, 8)
    with torch.no_grad():
        here, there = refiner(volumes, maps), refiner(volumes.roll(4, dims=2), maps)
    torch.testing.assert_close(there[:, 6:14], here[:, 2:10])
    assert float((here[:, 5:8] - here[:, 12:13]).abs().max()) > 1e-3


def test_every_weight_is_reached_by_the_gradient() -> None:
    network = disturbed(0.01)
    prediction = network.predict(*inputs(2, 64, 64))
    total = sum(values.square().mean() for values in prediction.outputs if values.requires_grad)
    total = total + prediction.logits.square().mean()
    total.backward()
    without = [n for n, p in network.named_parameters() if p.grad is None or not torch.isfinite(p.grad).all()]
    assert without == []
    assert sum(float(p.grad.abs().max()) > 0 for p in network.parameters()) > 0.9 * len(list(network.parameters()))


@pytest.mark.parametrize("position", [4.0, 4.3, 9.75])
def test_the_expected_level_is_found_to_a_fraction_of_a_candidate(position: float) -> None:
    index = torch.arange(16.0)[None, :, None, None]
    logits = (-0.5 * ((index - position) / 0.7).square()).clamp_min(-8) + torch.zeros(1, 16, 2, 2)
    level, mass = expected_level(logits)
    torch.testing.assert_close(level * 15, torch.full((1, 1, 2, 2), position), atol=0.02, rtol=0)
    assert float(mass.min()) > 0.9


def test_upsampling_never_leaves_the_range_of_the_neighbourhood() -> None:
    values = torch.rand(1, 1, 6, 6)
    found = convex_upsampling(values, 5 * torch.randn(1, 36, 6, 6))
    low = -functional.max_pool2d(-values, 3, 1, 1).repeat_interleave(2, 2).repeat_interleave(2, 3)
    high = functional.max_pool2d(values, 3, 1, 1).repeat_interleave(2, 2).repeat_interleave(2, 3)
    assert ((found >= low - 1e-6) & (found <= high + 1e-6)).all()
