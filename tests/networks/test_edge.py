"""The network `edge` in torch: what it makes stays within its bounds, and surfaces are closed."""

import numpy as np
import pytest
import torch
from networks.two_planes import network_tensors, trace
from torch import nn

from tinysplat.networks.edge import Edge
from tinysplat.networks.sweep import Sweep
from tinysplat.rasteriser import render
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.scene.cameras import Camera


@pytest.mark.parametrize("network", [Edge(), Sweep()])
def test_drawn_four_times_as_large_a_surface_has_no_holes(network: nn.Module) -> None:
    scene = trace(2, 96, 128)
    with torch.no_grad():
        outputs = network(*network_tensors(scene))
        camera = scene.cameras[0]
        K = np.diag([4, 4, 1]) @ camera.K
        K[:2, 2] -= 4 * 48, 4 * 32  # a part of the picture that both views show
        place = Camera(K, camera.c2w, 128, 128)
        layers = [
            torch.cat([a.reshape(-1, *a.shape[3:]), b.reshape(-1, *b.shape[3:])])
            for a, b in zip(outputs[:5], outputs[5:10], strict=True)
        ]
        means, quats, scales, opacities, sh = layers
        _, left = render(means, quats, scales, opacities, (0.5 + C0 * sh[:, 0]).clamp_min(0), place)
    assert float(left.max()) <= 0.02
