"""Where an error of depth shows, and the QPs that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.codec.depth_step.contrast import block_offsets, contrast


def _scene(colors: np.ndarray, opacity: float = 0.5):
    """Gaussians with degree-0 coefficients (V, H, W, 3)."""
    scene = make_smooth_gaussians(*colors.shape[:3], degree=0)
    return replace(scene, sh=colors[..., None, :].astype(np.float32), opacities=np.full(colors.shape[:3], opacity, "f"))


def test_contrast_is_at_edges_that_can_be_seen_and_nowhere_else():
    colors = np.zeros((1, 8, 8, 3))
    colors[:, :, 4:] = 1.0  # an edge between columns 3 and 4
    shown = contrast(_scene(colors))
    assert (shown[:, :, 3] > 0).all()
    assert not np.delete(shown, 3, axis=2).any()
    assert contrast(_scene(colors, opacity=0.25))[0, 0, 3] == pytest.approx(shown[0, 0, 3] / 4)
    assert not contrast(_scene(100 + colors)).any()  # white beyond white


def test_numbers_at_float32s_end_have_finite_contrast():
    colors = np.random.default_rng(0).standard_normal((1, 9, 9, 3)) * 1e38
    colors[0, 4, 4] = np.nan
    scene = _scene(np.zeros((1, 9, 9, 3)))
    object.__setattr__(scene, "sh", colors[..., None, :].astype(np.float32))
    assert np.isfinite(contrast(scene)).all()


def test_blocks_that_show_less_are_coarser():
    shown = np.ones((2, 64, 64), np.float32)
    shown[1, :32] = 0.01
    offsets = block_offsets(shown)
    assert (offsets[1, :2] > 0).all()
    assert (offsets[0] < 0).all() and (offsets[1, 2:] == offsets[0, 2:]).all()
