"""Gaussians widened by pixels of their own photos, for renderers that know of the screen's alone."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.footprints import own_pixels, widened
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.scene.cameras import Camera


def covariances(gaussians):
    quats = normalize_quats(gaussians.quats.reshape(-1, 4).astype(float))
    axes = quats_to_matrices(quats) * gaussians.scales.reshape(-1, 1, 3)
    return axes @ axes.swapaxes(1, 2)


def test_every_covariance_grows_by_its_photos_pixel_in_all_layers():
    scene = make_gaussians(3, 6, 8, layers=2)
    wide = widened(scene, 0.25)
    for before, after in zip(scene.layers, wide.layers, strict=True):
        z = [(m @ c.w2c[:3, :3].T + c.w2c[:3, 3])[..., 2] for m, c in zip(before.means, scene.cameras, strict=True)]
        half_pixel = np.stack(z).ravel() / (2 * scene.cameras[0].focal)  # whose square is a quarter of the pixel's
        added = covariances(after) - covariances(before)
        expected = half_pixel[:, None, None] ** 2 * np.eye(3)
        np.testing.assert_allclose(added, expected, rtol=1e-4, atol=1e-6 * covariances(after).max())
        np.testing.assert_array_equal(after.opacities, before.opacities)


def test_gaussians_of_no_photos_and_variances_that_are_none_are_refused():
    scene = make_gaussians(2, 4, 5)
    with pytest.raises(InputError):
        widened(scene.flat(), 0.1)
    for variance in (-0.1, float("nan"), float("inf"), "wide"):
        with pytest.raises(InputError):
            widened(scene, variance)


def test_a_pixel_is_as_wide_as_its_depth_over_the_focal_length():
    """From (1, 2, 3) along x, with f = √(20·5) = 10, of means about (0, 0, 7)."""
    c2w = np.array([[0.0, 0, 1, 1], [0, 1, 0, 2], [-1, 0, 0, 3], [0, 0, 0, 1]])
    camera = Camera([[20.0, 0, 3], [0, 5, 2], [0, 0, 1]], c2w, 6, 4)
    means = np.array([[[6.0, 9, -4], [1, 0, 0]], [[0.5, 0, 0], [41, -3, 8]]], np.float32)
    found = own_pixels(means, np.array([0.0, 0, 7]), camera)
    np.testing.assert_allclose(found, [[0.5, 0], [0, 4]], rtol=1e-6)
    assert found.dtype == np.float32
