"""What two Gaussians become when they are merged, and which ones are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_free_gaussians

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices

pytest.importorskip("numba")

from tinysplat_runtime.prune.merging import _neighbours, _unlikeness, choose, diagonalise, merged, principal_axes


def covariances(gaussians: Gaussians) -> np.ndarray:
    axes = quats_to_matrices(normalize_quats(gaussians.quats.astype(np.float64))) * gaussians.scales[:, None].astype(
        np.float64
    )
    return axes @ axes.swapaxes(1, 2)


@pytest.fixture
def pairs() -> Gaussians:
    """Forty far from one another, and beside each, forty rows later, one like it."""
    some = make_free_gaussians(40, 1, np.random.default_rng(1))
    places = 4 * np.random.default_rng(2).permutation(64)[:40, None] * [1, 0, 0] + 2 * some.means
    parts = [
        replace(some, means=places),
        replace(some, means=places + 0.3 * some.scales.min(axis=1, keepdims=True), scales=1.1 * some.scales),
    ]
    return Gaussians(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS})


def test_two_become_one_of_their_mass_mean_and_covariance(pairs: Gaussians) -> None:
    found = merged(pairs, np.arange(40), np.arange(40, 80))
    wide, areas = pairs.means.astype(np.float64), np.prod(pairs.scales.astype(np.float64), axis=1) ** (2 / 3)
    mass = (pairs.opacities * areas).reshape(2, 40)
    share = mass / mass.sum(axis=0)
    middle = (share[..., None] * wide.reshape(2, 40, 3)).sum(axis=0)
    away = wide.reshape(2, 40, 3) - middle
    spread = covariances(pairs).reshape(2, 40, 3, 3) + away[..., :, None] * away[..., None, :]
    np.testing.assert_allclose(found.means, middle, atol=1e-4)
    np.testing.assert_allclose(covariances(found), (share[..., None, None] * spread).sum(axis=0), atol=1e-5)
    np.testing.assert_allclose(
        found.sh, (share[..., None, None] * pairs.sh.reshape(2, 40, 4, 3)).sum(axis=0), atol=1e-5
    )
    area = np.prod(found.scales, axis=1) ** (2 / 3)
    np.testing.assert_allclose(found.opacities, np.minimum(mass.sum(axis=0) / area, 0.999), rtol=1e-3)


@pytest.mark.parametrize("change", ["far", "thin", "bright"])
def test_what_is_unlike_stays_as_it_is(pairs: Gaussians, change: str) -> None:
    is_gone = (np.arange(80) >= 40)[:, None]
    other = {
        "far": {"means": pairs.means + 5 * is_gone},
        "thin": {"scales": np.where(is_gone & (np.arange(3) == 0), 0.02, 1) * pairs.scales},
        "bright": {"sh": pairs.sh + 1.0 * is_gone[..., None] * (np.arange(4) == 0)[:, None]},
    }[change]
    apart = replace(pairs, **other)
    found = merged(apart, np.arange(40), np.arange(40, 80))
    assert all((getattr(found, name) == getattr(apart, name)[:40]).all() for name in FIELDS)


def test_axes_and_turns_make_the_matrix_again() -> None:
    rng = np.random.default_rng(3)
    made = rng.normal(size=(200, 3, 3)) * np.exp(rng.uniform(-4, 4, (200, 1, 3)))
    wanted = made @ made.swapaxes(1, 2)
    wanted[0], wanted[1] = np.eye(3), np.diag([4.0, 1.0, 9.0])
    lengths, turns = principal_axes(wanted)
    axes = quats_to_matrices(turns) * lengths[:, None]
    largest = np.abs(wanted).max(axis=(1, 2))[:, None, None]
    np.testing.assert_allclose(axes @ axes.swapaxes(1, 2) / largest, wanted / largest, atol=1e-12)


def spread_of(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Means, covariances, logarithms of the roots of their determinants, and colours."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, 3, 3))
    covariances = axes @ axes.swapaxes(1, 2) + 0.1 * np.eye(3)
    return (
        rng.normal(size=(count, 3)),
        covariances,
        0.5 * np.linalg.slogdet(covariances)[1],
        rng.uniform(size=(count, 3)),
    )


def bhattacharyya(means: np.ndarray, covariances: np.ndarray, one: int, other: int) -> float:
    middle, away = (covariances[one] + covariances[other]) / 2, means[one] - means[other]
    roots = np.sqrt(np.linalg.det(covariances[one]) * np.linalg.det(covariances[other]))
    return float(away @ np.linalg.inv(middle) @ away / 8 + 0.5 * np.log(np.linalg.det(middle) / roots))


def test_unlikeness_is_bhattacharyyas_distance_and_that_of_colours() -> None:
    means, covariances, logs, colours = spread_of(12, 0)
    for one, other in ((0, 1), (5, 3), (7, 7), (11, 2)):
        wanted = bhattacharyya(means, covariances, one, other) + np.abs(colours[one] - colours[other]).sum()
        assert _unlikeness(means, covariances, logs, colours, one, other) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    flat = np.zeros((2, 3, 3))
    assert _unlikeness(means, flat, logs, colours, 0, 1) == np.inf


def test_the_likest_of_what_was_looked_at_is_taken() -> None:
    means, covariances, logs, colours = spread_of(12, 1)
    distance = np.array([[_unlikeness(means, covariances, logs, colours, a, b) for b in range(12)] for a in range(12)])
    gone, into = np.array([8, 9, 10, 11]), np.full(4, -1)
    most = float(np.median(distance[8:, :8]))
    for candidate in range(8):
        choose(means, covariances, logs, colours, gone, (np.arange(4) + candidate) % 8, most, into)
    least = distance[8:, :8].min(axis=1)
    np.testing.assert_array_equal(into, np.where(least < most, distance[8:, :8].argmin(axis=1), -1))
    assert (into >= 0).any()
    none = np.full(4, -1)
    choose(means, covariances, logs, colours, gone, np.arange(4), 0.0, none)
    assert (none == -1).all()


def test_eigenvalues_and_vectors_are_numpys() -> None:
    rng = np.random.default_rng(4)
    made = rng.normal(size=(60, 3, 3))
    made = made @ made.swapaxes(1, 2) * np.exp(rng.uniform(-6, 6, (60, 1, 1)))
    made[0], made[1], made[2] = np.diag([3.0, 1, 2]), np.zeros((3, 3)), np.array([[2.0, 1, 0], [1, 2, 0], [0, 0, 5]])
    made[3] = np.array([[1.0, -1, 0], [-1, 1, 0], [0, 0, 1]])
    values, vectors = np.empty((60, 3)), np.empty((60, 3, 3))
    diagonalise(made, values, vectors)
    for number in range(60):
        scale = max(np.abs(made[number]).max(), 1e-300)
        np.testing.assert_allclose(
            np.sort(values[number]) / scale, np.linalg.eigvalsh(made[number]) / scale, atol=1e-12
        )
        np.testing.assert_allclose(
            made[number] @ vectors[number] / scale, vectors[number] * values[number] / scale, atol=1e-10
        )
        np.testing.assert_allclose(vectors[number].T @ vectors[number], np.eye(3), atol=1e-12)


def test_neighbours_are_six_before_and_after_along_each_of_two_curves() -> None:
    """Along a diagonal, where curves go straight on."""
    means = np.repeat(np.linspace(0, 1, 101)[:, None], 3, axis=1)
    kept, gone = np.flatnonzero(np.arange(101) % 2 == 0), np.array([51, 25, 3, 99])
    found = list(_neighbours(means, kept, gone))
    assert len(found) == 24
    for n, row in enumerate(gone):
        wanted = {int(r) for r in kept[np.argsort(np.abs(kept - row), kind="stable")[:12]]} if 12 < row < 88 else None
        seen = {int(one[n]) for one in found}
        assert seen <= set(kept.tolist()) and (wanted is None or seen == wanted)
        assert {row - 1, row + 1} <= seen


@pytest.mark.parametrize(("apart", "merges"), [(0.59, True), (0.61, False)])
def test_colours_may_differ_by_six_tenths_in_all(apart: float, merges: bool) -> None:
    some = make_free_gaussians(1, 0, np.random.default_rng(1))
    twice = Gaussians(**{name: np.concatenate([getattr(some, name)] * 2) for name in FIELDS})
    sh = twice.sh.copy()
    sh[1, 0] += np.array([0.2, -0.3, 0.5]) * apart / 0.28209479177387814
    pair = replace(twice, sh=sh, opacities=np.array([0.3, 0.3]))
    found = merged(pair, np.array([0]), np.array([1]))
    assert (found.opacities[0] == pytest.approx(0.6, rel=1e-4)) == merges and found.opacities.size == 1


def test_what_is_merged_is_never_quite_opaque_nor_thinner_than_a_thousandth() -> None:
    some = make_free_gaussians(1, 0, np.random.default_rng(1))
    twice = Gaussians(**{name: np.concatenate([getattr(some, name)] * 2) for name in FIELDS})
    flat = replace(twice, scales=np.array([[2.0, 1, 0], [2, 1, 0]]), opacities=np.array([0.9, 0.8]))
    found = merged(flat, np.array([1]), np.array([0]))
    assert found.opacities[0] == pytest.approx(0.999)
    np.testing.assert_allclose(np.sort(found.scales[0]), [2e-3, 1, 2], rtol=1e-4)
