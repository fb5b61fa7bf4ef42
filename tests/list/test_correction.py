"""What is left of a scene, corrected until pictures are again those of all of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from list.looks import error
from scenes import make_list

pytest.importorskip("numba")

from tinysplat_runtime.list.pruning.correction import corrected
from tinysplat_runtime.list.views import views_about
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.render.prepare import ALPHA_MIN
from tinysplat_runtime.system.threads import Crew


def drawn(gaussians, cameras):
    renderer = Renderer(gaussians, 1, **DEFINITION)
    return [renderer.render(camera) for camera in cameras]


@pytest.fixture(scope="module")
def scene():
    """Gaussians of SH degree 1, and the same a little off in every value that is corrected."""
    rng = np.random.default_rng(3)
    true = make_list(300, 1, rng)
    true = replace(true, scales=true.scales.clip(0.05), opacities=true.opacities.clip(0.2, 0.8))
    size = true.scales.mean(axis=1, keepdims=True)
    off = replace(
        true,
        means=true.means + 0.2 * size * rng.standard_normal(true.means.shape),
        scales=true.scales * np.exp(0.1 * rng.standard_normal(true.scales.shape)),
        opacities=true.opacities * np.exp(-0.2 * rng.random(300)),
    )
    return true, off


def test_pictures_come_nearer_to_those_wanted_from_unseen_places_too(scene):
    true, off = scene
    cameras, unseen = [camera.resized(96, 96) for camera in views_about(true, 12)], ring(true, 4)
    found = corrected(off, cameras, drawn(true, cameras), Crew(1).map)
    for views in (cameras, unseen):
        before, after = error(off, true, views), error(found, true, views)
        assert after < before


def test_what_is_not_wanted_fades_but_stays_what_may_show(scene):
    true, _ = scene
    cameras = [camera.resized(64, 64) for camera in views_about(true, 6)]
    faint = replace(true, opacities=np.full(true.count, 1.1 * ALPHA_MIN))
    found = corrected(faint, cameras, [np.zeros((64, 64, 3), np.float32)] * 6, Crew(1).map)
    assert found.opacities.min() >= ALPHA_MIN and found.opacities.mean() < faint.opacities.mean()
