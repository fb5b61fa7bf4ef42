"""What two Gaussians become when they are merged, and which ones are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_list

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices

pytest.importorskip("numba")

from tinysplat_runtime.list.pruning.merging import merged


def covariances(gaussians: Gaussians) -> np.ndarray:
    axes = quats_to_matrices(normalize_quats(gaussians.quats.astype(np.float64))) * gaussians.scales[:, None].astype(
        np.float64
    )
    return axes @ axes.swapaxes(1, 2)


@pytest.fixture
def pairs() -> Gaussians:
    """Forty far from one another, and beside each, forty rows later, one like it."""
    some = make_list(40, 1, np.random.default_rng(1))
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
    np.testing.assert_allclose(found.opacities, np.minimum(mass.sum(axis=0) / area, 1), atol=2e-3)
    assert found.opacities.max() < 1


def test_what_goes_becomes_part_of_what_is_likest(pairs: Gaussians) -> None:
    again = replace(pairs, sh=pairs.sh + 0.05 * (np.arange(4) == 0)[:, None])
    both = Gaussians(**{name: np.concatenate([getattr(one, name) for one in (pairs, again)]) for name in FIELDS})
    found = merged(both, np.arange(80), np.arange(120, 160))  # copies of the second of every two
    assert all((getattr(found, name)[:40] == getattr(pairs, name)[:40]).all() for name in FIELDS)
    assert (found.opacities[40:] >= pairs.opacities[40:]).all()
    np.testing.assert_allclose(found.sh[40:, 0], pairs.sh[40:, 0] + 0.025, atol=1e-5)
