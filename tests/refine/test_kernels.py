"""Slopes of what refinement adds to a photo's error, against finite differences and torch's Adam."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import make_smooth_gaussians

from tinysplat_runtime.refine import kernels
from tinysplat_runtime.refine.photos import sizes_of
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.scenes import Frame, Scene


def test_steps_are_those_of_torchs_adam_and_end_at_the_limits() -> None:
    rng = np.random.default_rng(3)
    values, first, second = rng.normal(size=40).astype(np.float32), *np.zeros((2, 40), np.float32)
    leaf = torch.tensor(values, requires_grad=True)
    optimiser = torch.optim.Adam([leaf], lr=0.05, betas=(0.9, 0.99), eps=2e-3)
    for count in range(1, 6):
        gradient = rng.normal(size=40).astype(np.float32)
        kernels.adam(values, gradient, first, second, (0.05, 0.9, 0.99, 2e-3, float(count), -9.0, 9.0))
        leaf.grad = torch.tensor(gradient)
        optimiser.step()
    np.testing.assert_allclose(values, leaf.detach().numpy(), atol=1e-6)
    outside = np.array([-3.0, 0.0, 3.0], np.float32)
    for slope, wanted in ((1, [-3.0, -0.5, 2.5]), (-1, [-2.5, 0.5, 3.0])):
        state = outside.copy()
        kernels.adam(
            state, np.full(3, slope, np.float32), *np.zeros((2, 3), np.float32), (0.5, 0.9, 0.99, 0.0, 1.0, -1.0, 1.0)
        )
        np.testing.assert_allclose(state, wanted, atol=1e-6)


@pytest.mark.parametrize(("factor", "count"), [(1, 1), (1.9, 1), (2, 2), (3, 2)])
def test_photos_of_twice_the_size_are_looked_at_too(tmp_path: Path, factor: float, count: int) -> None:
    gaussians = make_smooth_gaussians(2, 20, 24, degree=0)
    rng = np.random.default_rng(4)
    frames = []
    for n, camera in enumerate(gaussians.cameras):
        large = camera.resized(int(20 * factor), int(24 * factor))
        write_png(tmp_path / f"{n}.png", rng.uniform(size=(large.height, large.width, 3)))
        frames.append(Frame(large, tmp_path / f"{n}.png").resized(20, 24))
    sizes = sizes_of(gaussians, Scene(tmp_path, tuple(frames)))
    assert [targets[0].photo.shape[:2] for targets in sizes] == [(20, 24), (40, 48)][:count]
    for targets in sizes:
        for target, camera in zip(targets, gaussians.cameras, strict=True):
            assert (target.camera.height, target.camera.width) == target.photo.shape[:2]
            np.testing.assert_allclose(target.camera.K_unit, camera.K_unit, atol=0.03)
