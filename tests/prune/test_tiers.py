"""Which Gaussians come first in a file, and colours that make up for what steps lost of all else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from prune.looks import error
from scenes import make_free_gaussians

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.system.threads import Crew

pytest.importorskip("numba")

from tinysplat_runtime.prune import tiers, views
from tinysplat_runtime.prune.removal import Remover
from tinysplat_runtime.prune.tiers import tiers_of
from tinysplat_runtime.prune.views import views_about


@pytest.fixture(scope="module", autouse=True)
def _small() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(views, "SIDE", 96)
        patch.setattr(tiers, "LEAST_COUNT", 1000)
        yield


@pytest.fixture(scope="module")
def ball() -> Gaussians:
    """A ball of 200 large opaque Gaussians, speckled by 800 small ones on it."""
    some = make_free_gaussians(1000, 0, np.random.default_rng(0))
    means = some.means / np.linalg.norm(some.means, axis=1, keepdims=True)
    is_large = np.arange(1000)[:, None] < 200
    scales = np.where(is_large, 0.16, 0.03 * some.scales / 0.05).astype(np.float32)
    return replace(some, means=means * np.where(is_large, 0.95, 1), scales=scales, opacities=np.full(1000, 0.9))


def test_the_first_tiers_are_what_pictures_need_most(ball: Gaussians) -> None:
    remover = Remover(ball, views_about(ball, 8), Crew(2).map)
    found = tiers_of(remover, remover.whole)
    counts = np.bincount(found.numbers).tolist()
    assert len(counts) == len(found.levels) > 1 and (np.diff(counts) > 0).all()
    assert (np.flatnonzero(found.numbers < len(counts) - 1) < 200).mean() > 0.5  # of all, a fifth are large
    assert found.growths[0] >= found.growths[-1] >= 0
    first = replace(ball, **{name: getattr(ball, name)[found.numbers == 0] for name in FIELDS})
    grown = replace(first, scales=first.scales * np.float32(np.exp(found.growths[0])))
    cameras = [camera.resized(96, 96) for camera in ring(ball, 3)]
    assert error(grown, ball, cameras) < error(first, ball, cameras)


def test_few_gaussians_are_one_tier(ball: Gaussians) -> None:
    few = replace(ball, **{name: getattr(ball, name)[:999] for name in FIELDS})
    remover = Remover(few, views_about(few, 4), Crew(2).map)
    assert len(tiers_of(remover, remover.whole).levels) == 1
