"""The network `edge` in torch: at first it is its analytic part, it stays within its bounds, and its size is kept."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional
from two_planes import FAR, NEAR, trace

from tinysplat.networks.edge import OPACITY_CAP, OUTPUT_NAMES, Edge, EdgeSettings
from tinysplat.networks.edge_analysis import expected_level
from tinysplat.networks.edge_layers import convex_upsampling
from tinysplat.networks.narrowing import NarrowingSettings
from tinysplat.networks.sweep import AlignmentSettings, Sweep
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


def test_untrained_it_is_its_analytic_part() -> None:
    given = inputs(2, 64, 96)
    as_sweep = EdgeSettings(narrowing=NarrowingSettings(finest=1e3), half_alignment=AlignmentSettings(steps=0))
    with torch.no_grad():
        found = dict(zip(OUTPUT_NAMES, Edge(as_sweep)(*given), strict=True))
        expected = dict(zip(OUTPUT_NAMES, Sweep(EdgeSettings().analysis)(*given), strict=True))
    for name in ("layer1_sh", "layer1_quats", "layer1_opacities", "layer1_K"):
        torch.testing.assert_close(found[name], expected[name], atol=1e-5, rtol=1e-5)
    depth = (found["depth"] / expected["depth"] - 1).abs()
    # the coarser grids, which `sweep` does not look at, lead some pixels elsewhere
    assert float(depth.median()) < 1e-3 and float(depth.quantile(0.9)) < 0.02
    assert float((found["opacities"] - expected["opacities"]).abs().quantile(0.9)) < 0.05
    assert float((found["sh"] - expected["sh"]).abs().median()) < 0.04  # where neighbours change places, more


def test_depth_of_two_textured_planes_is_found_without_training() -> None:
    scene = trace(3, 96, 128)
    with torch.no_grad():
        depth = Edge()(*inputs(3, 96, 128))[OUTPUT_NAMES.index("depth")].numpy()
    error = np.abs(depth / scene.depth - 1)
    assert np.median(error) < 0.007 and np.quantile(error, 0.9) < 0.04


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
        layers = [torch.cat([a.reshape(-1, *a.shape[3:]), b.reshape(-1, *b.shape[3:])]) for a, b in
                  zip(outputs[:5], outputs[5:10], strict=True)]  # fmt: skip
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


def test_the_network_is_small_and_reads_few_warped_values(monkeypatch: pytest.MonkeyPatch) -> None:
    network = Edge()
    assert sum(p.numel() for p in network.parameters()) < 1_000_000
    work, read = [0], [0]
    original = functional.grid_sample

    def counted(images: Tensor, grid: Tensor, **options: object) -> Tensor:
        found = original(images, grid, **options)  # type: ignore[arg-type]
        read[0] += found.numel()
        return found

    def count(module: nn.Conv2d | nn.Conv3d, given: tuple[Tensor, ...], result: Tensor) -> None:
        work[0] += result.numel() * module.weight[0].numel()

    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Conv3d):
            module.register_forward_hook(count)
    monkeypatch.setattr(functional, "grid_sample", counted)
    with torch.no_grad():
        network(*inputs(2, 64, 64))
    ring = 2 * EdgeSettings().analysis.coarse.ring
    assert work[0] * 16 < 12e9  # 2×256×256; the ring counts sixteen times instead of once
    assert ring == 48
    # 64 × 64 pixels: the frame counts a sixteenth of 256 × 256, but the ring more than that
    assert 0 < 16 * read[0] <= 6.8e6


@pytest.mark.parametrize("position", [4.0, 4.3, 9.75])
def test_the_expected_level_is_found_to_a_fraction_of_a_candidate(position: float) -> None:
    index = torch.arange(16.0)[None, :, None, None]
    logits = (-0.5 * ((index - position) / 0.7).square()).clamp_min(-8) + torch.zeros(1, 16, 2, 2)
    level, mass = expected_level(logits)
    torch.testing.assert_close(level * 15, torch.full((1, 1, 2, 2), position), atol=0.02, rtol=0)
    assert float(mass.min()) > 0.9


def test_a_distant_second_candidate_does_not_pull_the_level() -> None:
    logits = torch.full((1, 16, 1, 1), -9.0)
    logits[0, [3, 12]] = torch.tensor([2.0, 1.9])[:, None, None]
    assert float(expected_level(logits)[0]) * 15 == pytest.approx(3, abs=1e-3)


def test_upsampling_starts_as_bilinear_interpolation() -> None:
    values = torch.rand(2, 1, 5, 7)
    network = Edge()
    found = convex_upsampling(values, network.bilinear.expand(2, 36, 5, 7))
    expected = functional.interpolate(values, scale_factor=2.0, mode="bilinear", align_corners=False)
    torch.testing.assert_close(found, expected, atol=5e-3, rtol=0)


def test_upsampling_never_leaves_the_range_of_the_neighbourhood() -> None:
    values = torch.rand(1, 1, 6, 6)
    found = convex_upsampling(values, 5 * torch.randn(1, 36, 6, 6))
    low = -functional.max_pool2d(-values, 3, 1, 1).repeat_interleave(2, 2).repeat_interleave(2, 3)
    high = functional.max_pool2d(values, 3, 1, 1).repeat_interleave(2, 2).repeat_interleave(2, 3)
    assert ((found >= low - 1e-6) & (found <= high + 1e-6)).all()
