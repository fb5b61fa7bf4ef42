"""The network `sweep` in torch: depth where it is known, finite outputs on hostile inputs, geometry by construction."""

from functools import lru_cache

import numpy as np
import torch
from networks.two_planes import TracedScene, network_tensors, trace
from torch import Tensor

from tinysplat.networks.sweep import OUTPUT_NAMES, Sweep


@lru_cache(maxsize=4)
def run_traced(views: int, height: int, width: int, spacing: float = 0.2) -> tuple[TracedScene, dict[str, Tensor]]:
    """The scene of two planes, and what the network makes of it."""
    scene = trace(views, height, width, spacing)
    with torch.no_grad():
        return scene, dict(zip(OUTPUT_NAMES, Sweep()(*network_tensors(scene)), strict=True))


def test_means_of_the_first_layer_project_to_their_pixels_centres():
    scene, outputs = run_traced(2, 64, 96)
    means = outputs["means"].double().numpy()
    row, column = np.mgrid[:64, :96] + 0.5
    for view, camera in zip(means, scene.cameras, strict=True):
        local = (view - camera.centre) @ camera.rotation.T @ camera.K.T
        assert np.abs(local[..., 0] / local[..., 2] - column).max() < 1e-3
        assert np.abs(local[..., 1] / local[..., 2] - row).max() < 1e-3
