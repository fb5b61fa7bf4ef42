"""Halved copies of Gaussians: they look like the original in half the size, and their changes reach every pixel."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_smooth_gaussians
from scipy.ndimage import map_coordinates

import tinysplat_runtime as ts
from tinysplat_runtime.refine.coarse import bring_up, halved, halved_camera
from tinysplat_runtime.refine.settings import LIMITS

pytest.importorskip("numba")

from tinysplat_runtime.render.gradient import MovableGaussians


def movable(gaussians: ts.Gaussians) -> MovableGaussians:
    return MovableGaussians(gaussians, lambda work, items: [work(item) for item in items])


@pytest.mark.parametrize("size", [(48, 64), (49, 63)])
def test_a_halved_copy_shows_the_halved_picture(size: tuple[int, int]) -> None:
    gaussians = make_smooth_gaussians(2, *size)
    copy = halved(gaussians)
    assert np.median(copy.scales) == pytest.approx(2 * np.median(gaussians.scales), rel=0.1)
    for camera in gaussians.cameras:
        whole = ts.render(gaussians, camera)[: size[0] // 2 * 2, : size[1] // 2 * 2]
        means = whole.reshape(size[0] // 2, 2, size[1] // 2, 2, 3).mean(axis=(1, 3))
        shown = ts.render(copy, halved_camera(camera))
        assert -10 * np.log10(np.mean((shown - means)[2:-2, 2:-2] ** 2)) > 26


@pytest.mark.parametrize("size", [(12, 16), (13, 15)])
def test_changes_of_a_copy_are_interpolated_between_its_pixels(size: tuple[int, int]) -> None:
    """Held to scipy's interpolation, at where a pixel's centre lies among those of the copy."""
    gaussians = make_smooth_gaussians(2, *size)
    field, smaller = movable(gaussians), movable(halved(gaussians))
    before, start = field.values.copy(), smaller.values.copy()
    change = np.random.default_rng(0).normal(0, 0.5, start.shape).astype(np.float32)
    smaller.values[:] = start + change
    bring_up(field, smaller, start)
    places = np.meshgrid(*((np.arange(side) - 0.5) / 2 for side in size), indexing="ij")
    for whole, half in zip(field.grids, smaller.grids, strict=True):
        for kind, (least, greatest) in enumerate(LIMITS):
            coarse = (smaller.values[kind, half.rows] - start[kind, half.rows]).reshape(half.height, half.width)
            was = before[kind, whole.rows].reshape(size)
            wanted = was + map_coordinates(coarse, places, order=1, mode="nearest")
            wanted = wanted.clip(np.minimum(was, least), np.maximum(was, greatest))
            np.testing.assert_allclose(field.values[kind, whole.rows].reshape(size), wanted, atol=1e-5)
