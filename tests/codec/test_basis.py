"""VABR on the host: weightings, eigenvectors, signs."""

import numpy as np
import pytest
from scenes import make_skewed_cameras

from tinysplat_runtime.codec.basis import (
    mean_magnitude_weighting,
    reduce_basis,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from tinysplat_runtime.gaussian.sh import sh_basis


def _moment(d: int, rank: int | None = None, seed: int = 0) -> np.ndarray:
    x = np.random.default_rng(seed).standard_normal((rank or 4 * d, d)) / (1 + np.arange(d))
    return x.T @ x / len(x)


def test_directions_are_unit_rays_through_the_cell_centres_of_every_view():
    cameras = make_skewed_cameras(3, 10, 20, turn=0.7)
    for camera, rays in zip(cameras, view_directions(cameras).reshape(3, 9, 3), strict=True):
        there = (camera.centre + 5 * rays - camera.c2w[:3, 3]) @ np.linalg.inv(camera.c2w[:3, :3]).T @ camera.K.T
        cells = [((column + 0.5) * 20 / 3, (row + 0.5) * 10 / 3) for row in range(3) for column in range(3)]
        np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1)
        np.testing.assert_allclose(there[:, :2] / there[:, 2:], cells, atol=1e-9)


def test_the_second_moment_weighting_measures_the_mean_squared_colour():
    directions = view_directions(make_skewed_cameras(3, 20, 30, turn=0.6))
    x = np.random.default_rng(0).standard_normal(16)
    seen = (sh_basis(directions, 3) @ x) ** 2
    assert np.sum((second_moment_weighting(directions, 3) @ x) ** 2) == pytest.approx(seen.mean(), rel=1e-3)


@pytest.mark.parametrize("k", [1, 6, 48])
def test_projection_is_an_exact_left_inverse_of_what_the_file_stores(k):
    weighting = mean_magnitude_weighting(view_directions(make_skewed_cameras(2, 16, 16)), 3)
    reduction = reduce_basis(weighted_spectrum(_moment(48), weighting), weighting, k)
    product = reduction.projection.T @ reduction.inverse.astype(np.float64)
    np.testing.assert_allclose(product, np.eye(k), atol=1e-9)
