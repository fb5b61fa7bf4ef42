"""`edge` on photos that do not match, and on depth ranges that are far off: finite Gaussians within their bounds."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from two_planes import FAR, NEAR, network_inputs, trace

from tinysplat.networks.edge import OUTPUT_NAMES, Edge

KINDS = ["one black", "all equal", "noise", "range ten times too wide", "range ten times too far", "range too narrow"]


@pytest.mark.parametrize("kind", KINDS)
def test_gaussians_are_finite(kind: str) -> None:
    scene = trace(2, 32, 48)
    images, near, far = scene.images.copy(), NEAR, FAR
    match kind:
        case "one black":
            images[1] = 0
        case "all equal":
            images[1:] = images[0]
        case "noise":
            images = np.random.default_rng(0).random(images.shape).astype(np.float32)
        case "range ten times too wide":
            near, far = near / 10, far * 10
        case "range ten times too far":
            near, far = near * 10, far * 10
        case _:
            near, far = far / 1.01, far
    given = {name: torch.from_numpy(array) for name, array in network_inputs(images, scene.cameras, near, far).items()}
    with torch.no_grad():
        outputs = dict(zip(OUTPUT_NAMES, Edge()(**given), strict=True))
    for name, values in outputs.items():
        assert torch.isfinite(values).all(), name
    for layer in ("", "layer1_"):
        opacities = outputs[f"{layer}opacities"]
        assert float(opacities.min()) >= 0 and float(opacities.max()) <= 1
        assert float(outputs[f"{layer}scales"].min()) > 0
    assert float(outputs["depth"].min()) >= near * (1 - 1e-5) and float(outputs["depth"].max()) <= far * (1 + 1e-5)
