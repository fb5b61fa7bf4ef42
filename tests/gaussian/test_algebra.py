"""Quaternions and spherical harmonics against independent definitions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis

QUATS = normalize_quats(np.random.default_rng(0).standard_normal((500, 4)))


def test_matrices_agree_with_scipy():
    wanted = Rotation.from_quat(QUATS[:, [1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(quats_to_matrices(QUATS), wanted, atol=1e-14)


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), [[0.6, 0.8, 0]], [[1, 1, 1]]]))
@pytest.mark.parametrize("angle", [0, 1e-12, 1e-4, 1.0, np.pi - 1e-6, np.pi, np.pi + 1e-12])
def test_quats_of_matrices_are_exact_at_every_angle(axis, angle):
    matrix = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    np.testing.assert_allclose(quats_to_matrices(matrices_to_quats(matrix)), matrix, atol=1e-14)


@pytest.mark.parametrize("factor", [1e-300, 1e-30, 1, 1e300])
def test_normalising_survives_any_length(factor):
    np.testing.assert_allclose(normalize_quats(QUATS * factor), QUATS, atol=1e-12)


def test_sh_basis_is_the_real_basis_of_scipy_with_the_condon_shortley_phase_kept():
    d = np.random.default_rng(1).standard_normal((300, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    theta, phi = np.arccos(d[:, 2]), np.arctan2(d[:, 1], d[:, 0])
    wanted = []
    for degree in range(5):
        for m in range(-degree, degree + 1):
            y = sph_harm_y(degree, abs(m), theta, phi)
            wanted.append(y.real if m == 0 else np.sqrt(2) * (y.imag if m < 0 else y.real))
    np.testing.assert_allclose(sh_basis(d, 4), np.stack(wanted, -1), atol=1e-13)
