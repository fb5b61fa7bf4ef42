"""What colours are fitted with: directions, weights and lacks by view, and what coefficients cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_cameras, make_free_gaussians

pytest.importorskip("numba")

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.prune import kernels, removal
from tinysplat_runtime.prune.removal import Remover
from tinysplat_runtime.system.threads import Crew

COUNT, VIEWS = 30, 5


class Told:
    """In place of pictures: sums that tell Gaussian, view and column."""

    def __init__(self, cameras, run_jobs) -> None:
        self.cameras, self.values = tuple(cameras), 1

    def measure(self, gaussians: Gaussians, views):
        for view in views:
            sums = np.arange(5.0) + 10 * np.arange(len(gaussians.means))[:, None] + 1000 * view
            yield sums.astype(np.float32)

    def errors(self, gaussians: Gaussians):
        yield 0.0


def remover(degree: int, monkeypatch: pytest.MonkeyPatch) -> Remover:
    monkeypatch.setattr(removal, "Pictures", Told)
    cloud = make_free_gaussians(COUNT, degree, np.random.default_rng(0))
    cloud = replace(cloud, origin=np.array([3.0, -2, 5]))
    return Remover(cloud, make_cameras(VIEWS, 8, 12), Crew(1).map)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_sums_are_kept_by_view_where_colours_depend_on_it(degree: int, monkeypatch: pytest.MonkeyPatch) -> None:
    found = remover(degree, monkeypatch)
    assert [list(half) for half in found._halves] == [[0, 2, 4], [1, 3]]
    seen = found._look(found._all, [1, 3])
    own = 10 * np.arange(COUNT)
    np.testing.assert_allclose(seen.costs, 2 * own + 4000)
    if degree:
        np.testing.assert_array_equal(seen.weights, np.stack([own + 1004, own + 3004], axis=1))
        np.testing.assert_array_equal(seen.lacks[:, 1], own[:, None] + 3000 + np.array([1, 2, 3]))
    else:
        np.testing.assert_array_equal(seen.weights, (2 * own + 4008)[:, None])
        np.testing.assert_array_equal(seen.lacks[:, 0], 2 * own[:, None] + 4000 + np.array([2, 4, 6]))


@pytest.mark.parametrize(("degree", "penalties"), [(0, ()), (1, (8.0, 3.0)), (2, (8.0, 3.0)), (2, ())])
def test_colours_are_fitted_to_views_by_their_directions(degree: int, penalties: tuple, monkeypatch) -> None:
    found, given = remover(degree, monkeypatch), []
    monkeypatch.setattr(removal, "_ROWS", 20)

    def solve(basis, weights, lacks, by_function, hold, relaxation, sh) -> None:
        given.append((basis, weights, lacks, by_function))
        assert (hold, relaxation) == (0.2, 1.5) and basis.dtype == weights.dtype == lacks.dtype == np.float64
        sh += 1

    monkeypatch.setattr(kernels, "solve_colours", solve)
    views = [0, 2, 4]
    seen = found._look(found._all, views)
    sh = found._recoloured(found._all, seen, views, penalties)
    np.testing.assert_allclose(sh, found._all.sh + 1, atol=1e-6)
    assert [len(one[0]) for one in given] == [20, 10]
    chosen = [found._pictures.cameras[view] for view in (views if degree else views[:1])]
    for column, camera in enumerate(chosen):
        towards = found._all.means + found._all.origin - camera.centre
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        basis = np.concatenate([one[0][:, column] for one in given])
        np.testing.assert_allclose(basis, sh_basis(towards, degree), atol=1e-6)
    np.testing.assert_array_equal(np.concatenate([one[1] for one in given]), seen.weights)
    np.testing.assert_array_equal(np.concatenate([one[2] for one in given]), seen.lacks)
    wanted = np.zeros((degree + 1) ** 2)
    for band, penalty in enumerate(penalties[:degree], start=1):
        wanted[band**2 : (band + 1) ** 2] = penalty * 3 / 5  # of these views' share
    np.testing.assert_allclose(given[0][3], wanted)
    given.clear()
    both = found.recoloured(found._all, penalties)
    np.testing.assert_allclose(both.sh, found._all.sh + 2, atol=1e-6)
    assert len(given) == 4 and both.means is found._all.means


def test_what_hardly_showed_is_left_alone_and_the_rest_merged_where_that_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of ten that went, the five dearest are offered; of the two results the better one is kept."""
    found, offered = remover(1, monkeypatch), []
    found._prices = np.random.default_rng(1).permutation(COUNT).astype(float)

    def merged(whole: Gaussians, rows: np.ndarray, shown: np.ndarray) -> Gaussians:
        offered.append((rows.tolist(), shown.tolist()))
        kept = removal.taken(whole, rows)
        return replace(kept, opacities=np.full(rows.size, 0.25))

    monkeypatch.setattr(removal, "merged", merged)
    monkeypatch.setattr(Remover, "recoloured", lambda self, one, penalties=(): one)
    monkeypatch.setattr(Remover, "_corrected", lambda self, one: one)
    for better in (0.25, 0.5):
        monkeypatch.setattr(Remover, "error_of", lambda self, one, best=better: float(abs(one.opacities[0] - best)))
        found._all = replace(found._all, opacities=np.full(COUNT, 0.5))
        rows = np.sort(np.argsort(found._prices)[10:])
        left = found._without(rows, ())
        gone = np.argsort(found._prices)[:10]
        assert offered.pop() == (rows.tolist(), sorted(gone[5:].tolist()))
        assert left.gaussians.opacities[0] == better and left.left_out == 10 and left.rows.tolist() == rows.tolist()
    assert found._without(np.arange(COUNT), ()).left_out == 0 and not offered
