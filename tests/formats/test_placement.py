"""Gaussians under a node's matrix: means, covariances and colours follow it, and what none can follow is refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.placement import placed
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis

RNG = np.random.default_rng(0)
GIVEN = {
    "means": RNG.normal(size=(5, 3)), "quats": normalize_quats(RNG.normal(size=(5, 4))),
    "scales": RNG.uniform(0.1, 1, (5, 3)), "opacities": RNG.uniform(0.1, 1, 5), "sh": RNG.normal(size=(5, 9, 3)),
}  # fmt: skip


def covariances(arrays: dict[str, NDArray]) -> NDArray:
    axes = quats_to_matrices(normalize_quats(arrays["quats"])) * arrays["scales"][:, None]
    return axes @ axes.swapaxes(1, 2)


def matrix(linear: NDArray, shift: tuple[float, ...] = (0.0, 0.0, 0.0)) -> NDArray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = linear, shift
    return found


def test_the_identity_gives_back_the_very_arrays() -> None:
    assert placed(GIVEN, np.eye(4)) is GIVEN


@pytest.mark.parametrize("scale", [1e-3, 1.0, 2.5, 700.0])
@pytest.mark.parametrize("seed", range(12))
def test_rotation_scale_and_translation_are_followed(scale: float, seed: int) -> None:
    R = quats_to_matrices(normalize_quats(np.random.default_rng(seed).normal(size=4)))
    found = placed(GIVEN, matrix(scale * R, (3, -2, 0.5)))
    np.testing.assert_allclose(found["means"], GIVEN["means"] @ (scale * R).T + [3, -2, 0.5], rtol=1e-9, atol=1e-12)
    wanted = scale**2 * R @ covariances(GIVEN) @ R.T
    np.testing.assert_allclose(covariances(found), wanted, rtol=1e-6, atol=1e-9 * scale**2)
    directions = np.random.default_rng(seed).normal(size=(5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = np.einsum("nb,nbc->nc", sh_basis(directions, 2), GIVEN["sh"])
    after = np.einsum("nb,nbc->nc", sh_basis(directions @ R.T, 2), found["sh"])
    np.testing.assert_allclose(after, before, atol=1e-6)
    np.testing.assert_array_equal(found["opacities"], GIVEN["opacities"])


def test_without_a_turn_rotations_and_colours_are_left_alone() -> None:
    found = placed(GIVEN, matrix(2 * np.eye(3), (1, 2, 3)))
    assert found["quats"] is GIVEN["quats"] and found["sh"] is GIVEN["sh"]
    np.testing.assert_allclose(found["scales"], 2 * GIVEN["scales"])
    np.testing.assert_allclose(found["means"], 2 * GIVEN["means"] + [1, 2, 3])


SHEAR = np.array([[1.0, 0.02, 0], [0, 1, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("linear", "said"),
    [
        (np.diag([-1.0, 1, 1]), "stretches or mirrors"), (np.diag([1.0, 1, -1]), "stretches or mirrors"),
        (-np.eye(3), "stretches or mirrors"), (np.diag([1.0, 1, 1.01]), "stretches or mirrors"),
        (np.diag([1.01, 1, 1]), "stretches or mirrors"), (np.diag([1.0, 1.01, 1]), "stretches or mirrors"),
        (SHEAR, "stretches or mirrors"), (SHEAR.T, "stretches or mirrors"), (np.zeros((3, 3)), "no similarity"),
        (np.diag([1.0, 1, 0]), "no similarity"), (np.diag([0.0, 1, 1]), "no similarity"),
        (np.array([[0.0, 1, 1], [0, 0, 1], [0, 1, 0]]), "no similarity"),
        (np.full((3, 3), np.nan), "no similarity"), (np.diag([np.inf, 1, 1]), "no similarity"),
    ],
)  # fmt: skip
def test_what_no_gaussian_can_follow_is_refused(linear: NDArray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        placed(GIVEN, matrix(linear))


def test_rounding_of_a_thousandth_is_borne() -> None:
    assert placed(GIVEN, matrix(np.diag([1.0004, 1, 1])))["means"].shape == (5, 3)
    with pytest.raises(InputError, match="stretches"):
        placed(GIVEN, matrix(np.diag([1.002, 1, 1])))
