"""Where an error of depth shows, and the QPs that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.codec.depth_step.contrast import LARGEST_OFFSET, block_offsets, contrast
from tinysplat_runtime.gaussian.planes import MAX_QP_BLOCKS
from tinysplat_runtime.gaussian.sh import C0


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


def test_contrast_is_what_differs_to_the_right_and_below():
    rng = np.random.default_rng(3)
    scene = _scene(rng.uniform(-3, 3, (2, 6, 7, 3)))
    opacities = rng.uniform(0.1, 1, (2, 6, 7)).astype(np.float32)
    shown = contrast(replace(scene, opacities=opacities))
    seen = np.clip(0.5 + scene.sh[..., 0, :].astype(np.float64) * C0, 0, 1)
    for v, i, j in np.ndindex(2, 6, 7):
        beside = [seen[v, a, b] for a, b in ((i + 1, j), (i, j + 1)) if a < 6 and b < 7]
        wanted = sum(((seen[v, i, j] - other) ** 2).sum() for other in beside) * opacities[v, i, j] ** 2
        assert shown[v, i, j] == pytest.approx(wanted, abs=1e-6)


def test_numbers_at_float32s_end_have_finite_contrast():
    colors = np.random.default_rng(0).standard_normal((1, 9, 9, 3)) * 1e38
    colors[0, 4, 4] = np.nan
    scene = _scene(np.zeros((1, 9, 9, 3)))
    object.__setattr__(scene, "sh", colors[..., None, :].astype(np.float32))
    assert np.isfinite(contrast(scene)).all()


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (17, 33), (100, 70)])
def test_there_is_an_offset_for_every_block_started(size):
    shown = np.random.default_rng(0).random((3, *size)).astype(np.float32)
    offsets = block_offsets(shown)
    assert offsets.shape == (3, -(-size[0] // 16), -(-size[1] // 16))
    assert np.abs(offsets).max(initial=0) <= LARGEST_OFFSET
    assert abs(offsets.mean()) < 1


def test_blocks_that_show_less_are_coarser():
    shown = np.ones((2, 64, 64), np.float32)
    shown[1, :32] = 0.01
    offsets = block_offsets(shown)
    assert (offsets[1, :2] > 0).all()
    assert (offsets[0] < 0).all() and (offsets[1, 2:] == offsets[0, 2:]).all()


def test_where_nothing_shows_all_blocks_are_alike():
    assert not block_offsets(np.zeros((2, 40, 40), np.float32)).any()


def test_large_planes_have_larger_blocks():
    shown = np.random.default_rng(0).random((1, 1100, 1300)).astype(np.float32) ** 8
    offsets = block_offsets(shown)
    assert offsets.shape == (1, 69, 82)
    side = 4  # blocks of 64 pixels: 18 × 21 are no more than allowed, 35 × 41 are
    assert 18 * 21 <= MAX_QP_BLOCKS < 35 * 41
    np.testing.assert_array_equal(offsets[:, ::side, ::side].repeat(side, 1).repeat(side, 2)[:, :69, :82], offsets)
