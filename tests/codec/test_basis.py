"""VABR on the host: weightings, eigenvectors, signs."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_skewed_cameras

from tinysplat_runtime.codec.basis import (
    LAMBDA_FLOOR,
    mean_magnitude_weighting,
    needed_degree,
    reduce_basis,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from tinysplat_runtime.gaussian.sh import C0, sh_basis
from tinysplat_runtime.scene.cameras import Camera


def _square_camera() -> Camera:
    return Camera(np.array([[64.0, 0, 32], [0, 64, 32], [0, 0, 1]]), np.eye(4), 64, 64)


def _moment(d: int, rank: int | None = None, seed: int = 0) -> np.ndarray:
    x = np.random.default_rng(seed).standard_normal((rank or 4 * d, d)) / (1 + np.arange(d))
    return x.T @ x / len(x)


def test_directions_are_unit_rays_through_the_cell_centres_of_every_view():
    cameras = [_square_camera(), *make_skewed_cameras(2, 10, 20)]
    rays = view_directions(cameras)
    assert rays.shape == (27, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1)
    corner = np.array([(64 / 6 - 32) / 64, (64 / 6 - 32) / 64, 1])
    np.testing.assert_allclose(rays[0], corner / np.linalg.norm(corner))
    np.testing.assert_allclose(rays[4], [0, 0, 1], atol=1e-15)


def test_directions_of_turned_cameras_meet_their_cell_centres():
    """A point on a ray is seen by the camera at the centre of the ray's cell."""
    cameras = make_skewed_cameras(3, 10, 20, turn=0.7)
    for camera, rays in zip(cameras, view_directions(cameras).reshape(3, 9, 3), strict=True):
        there = (camera.centre + 5 * rays - camera.c2w[:3, 3]) @ np.linalg.inv(camera.c2w[:3, :3]).T @ camera.K.T
        cells = [((column + 0.5) * 20 / 3, (row + 0.5) * 10 / 3) for row in range(3) for column in range(3)]
        np.testing.assert_allclose(there[:, :2] / there[:, 2:], cells, atol=1e-9)


def test_lambda_is_floored_where_a_world_aligned_square_camera_makes_it_vanish():
    directions = view_directions([_square_camera()])
    magnitudes = np.abs(sh_basis(directions, 4)).mean(axis=0)
    assert magnitudes[16] < 1e-12  # (l, m) = (4, −4)
    weighting = np.diag(mean_magnitude_weighting(directions, 4))
    assert weighting[16] == LAMBDA_FLOOR
    assert weighting[0] == pytest.approx(C0)


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


def test_energy_lost_is_the_share_of_the_weighted_energy_behind_k():
    weighting = np.eye(4)
    moment = np.kron(np.diag([8.0, 4.0, 2.0, 1.0]), np.eye(3))
    reduction = reduce_basis(weighted_spectrum(moment, weighting), weighting, 6)
    assert reduction.energy_lost == pytest.approx(3 / 15)
    np.testing.assert_allclose(weighted_spectrum(moment, weighting)[0], np.repeat([8.0, 4.0, 2.0, 1.0], 3))


def test_columns_fall_in_energy_and_their_largest_entry_is_positive():
    weighting = second_moment_weighting(view_directions(make_skewed_cameras(2, 16, 16)), 2)
    reduction = reduce_basis(weighted_spectrum(_moment(27), weighting), weighting, 10)
    vectors = np.kron(weighting, np.eye(3)) @ reduction.inverse.astype(np.float64)
    leading = np.abs(vectors).argmax(axis=0)
    assert (vectors[leading, range(10)] > 0).all()
    energies = np.einsum(
        "dk,de,ek->k", vectors, np.kron(weighting, np.eye(3)) @ _moment(27) @ np.kron(weighting, np.eye(3)), vectors
    )
    assert (np.diff(energies) <= 1e-3 * energies[0]).all()


@pytest.mark.parametrize("moment", [np.zeros((12, 12)), np.ones((12, 12)), np.eye(12), _moment(12, rank=2)])
@pytest.mark.parametrize("k", [1, 6, 12])
def test_degenerate_moments_give_finite_maps(moment, k):
    weighting = np.diag([0.28, 1e-4, 0.3, 0.1])
    reduction = reduce_basis(weighted_spectrum(moment, weighting), weighting, k)
    assert np.isfinite(reduction.inverse).all() and np.isfinite(reduction.projection).all()
    assert 0 <= reduction.energy_lost <= 1


def test_needed_degree_is_the_least_whose_rest_is_within_the_budget():
    cameras = make_skewed_cameras(2, 20, 30)
    directions = view_directions(cameras)
    rng = np.random.default_rng(0)
    x = rng.standard_normal((500, 16, 3)) * np.repeat([1, 0.1, 0.01, 0.001], [1, 3, 5, 7])[:, None]
    moment = x.reshape(500, 48).T @ x.reshape(500, 48) / 500
    for lower in range(4):
        rest = np.einsum("nbc,db->ndc", x[:, (lower + 1) ** 2 :], sh_basis(directions, 3)[:, (lower + 1) ** 2 :])
        energy = float(np.square(rest).sum(axis=-1).mean())
        assert needed_degree(moment, directions, 3, energy * 1.001 + 1e-12) == lower
        assert lower == 3 or needed_degree(moment, directions, 3, energy * 0.999) == lower + 1
