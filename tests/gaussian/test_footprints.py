"""Gaussians widened by pixels of their own photos, for renderers that know of the screen's alone."""

from dataclasses import replace

import numpy as np
from scenes import make_gaussians

from tinysplat_runtime.gaussian.footprints import widened
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices


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


def test_a_lists_covariances_grow_by_the_pixel_of_the_photo_that_shows_each_largest():
    scene = make_gaussians(3, 6, 8)
    found = replace(scene.flat(), viewpoints=scene.cameras)
    z = [(found.means @ c.w2c[:3, :3].T + c.w2c[:3, 3])[:, 2] for c in scene.cameras]
    nearest = np.where(np.stack(z) > 0, np.stack(z), np.inf).min(axis=0) / scene.cameras[0].focal
    added = covariances(widened(found, 0.25)) - covariances(found)
    expected = (nearest / 2)[:, None, None] ** 2 * np.eye(3)
    np.testing.assert_allclose(added, expected, rtol=1e-3, atol=1e-6 * expected.max())
