"""The network `sweep` in torch: depth where it is known, finite outputs on hostile inputs, geometry by construction."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import torch
from networks.two_planes import TracedScene, network_tensors, trace
from torch import Tensor

from tinysplat.networks.geometry import (
    pixel_rays,
    project_sweep,
    relative_pose,
    sweep_coefficients,
    tilt_quats,
    unproject,
)
from tinysplat.networks.surfels import surface_slopes
from tinysplat.networks.sweep import OUTPUT_NAMES, Sweep
from tinysplat_runtime.gaussian.quaternions import quats_to_matrices


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


def test_warp_agrees_with_projecting_points_in_float64():
    scene = trace(2, 20, 28)
    first, second = scene.cameras
    K, c2w = (torch.from_numpy(np.float32([getattr(c, name) for c in scene.cameras])) for name in ("K", "c2w"))
    terms = sweep_coefficients(pixel_rays(K[:1], 20, 28), K[1:], *relative_pose(c2w[:1], c2w[1:]))
    x, y, ratio = project_sweep(*terms, torch.from_numpy(np.float32(1 / scene.depth[:1]))[:, None])
    row, column = np.mgrid[:20, :28] + 0.5
    rays = np.stack([column, row, np.ones_like(row)], -1) @ np.linalg.inv(first.K).T
    world = (rays * scene.depth[0][..., None]) @ first.c2w[:3, :3].T + first.centre
    there = (world - second.centre) @ second.c2w[:3, :3]
    pixel = there @ second.K.T
    np.testing.assert_allclose(x[0, 0], pixel[..., 0] / pixel[..., 2], atol=2e-4)
    np.testing.assert_allclose(y[0, 0], pixel[..., 1] / pixel[..., 2], atol=2e-4)
    np.testing.assert_allclose(ratio[0, 0], there[..., 2] / scene.depth[0], atol=1e-5)
    points = unproject(pixel_rays(K[:1], 20, 28), torch.from_numpy(np.float32(scene.depth[:1]))[:, None], c2w[:1])
    np.testing.assert_allclose(points[0].permute(1, 2, 0), world, atol=1e-5)


@pytest.mark.parametrize(("slope_x", "slope_y"), [(0.0, 0.0), (0.8, -0.3), (-1.5, 1.2)])
def test_slopes_and_tilt_are_those_of_a_slanted_plane(slope_x, slope_y):
    K = torch.tensor([[[40.0, 0.0, 16.0], [0.0, 44.0, 12.0], [0.0, 0.0, 1.0]]])
    rays = pixel_rays(K, 24, 32)
    # z = 3 + a·x + b·y with x = z·ray_x: 1/z = (1 − a·ray_x − b·ray_y) / 3
    inverse_depth = (1 - slope_x * rays[:, :1] - slope_y * rays[:, 1:2]) / 3
    slopes = surface_slopes(inverse_depth, rays, K)[:, :, 1:-1, 1:-1]  # borders are one-sided
    visible = (inverse_depth > 0.1)[:, :, 1:-1, 1:-1]
    for axis, expected in enumerate((slope_x, slope_y)):
        found = slopes[:, axis : axis + 1][visible]
        torch.testing.assert_close(found, torch.full_like(found, expected), atol=1e-3, rtol=0)
    quat = tilt_quats(torch.tensor(slope_x), torch.tensor(slope_y)).numpy()
    normal = quats_to_matrices(np.float64(quat))[:, 2]
    expected = np.array([-slope_x, -slope_y, 1.0])
    np.testing.assert_allclose(normal, expected / np.linalg.norm(expected), atol=1e-6)
