"""Smaller copies show what their originals do, what changes in them comes back smoothly, and steps gain by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.refine.coarse import halved, halved_target
from tinysplat_runtime.refine.stats import RefineStats
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.render.gradient import Target
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.scenes import Frame, Scene


def test_a_copy_of_fewer_gaussians_shows_the_same() -> None:
    """Nearer to the photo than that is to itself half a pixel aside."""
    whole = make_smooth_gaussians(2, 25, 40, degree=0)
    whole = replace(whole, opacities=np.full_like(whole.opacities, 0.9))
    half, target = halved(whole), halved_target(Target(whole.cameras[0], Renderer(whole, 1).render(whole.cameras[0])))
    aside = [(target.photo + np.roll(target.photo, 1, axis)) / 2 for axis in (0, 1)]
    pictures = (Renderer(half, 1).render(target.camera), *aside)
    found, *more = (np.square(picture - target.photo)[1:-1, 1:-1].mean() for picture in pictures)
    assert half.count < 0.3 * whole.count and found < min(more)


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory):
    """Gaussians too faint here and there, and photos of what they should be."""
    folder, whole = tmp_path_factory.mktemp("photos"), make_smooth_gaussians(3, 96, 100, degree=0)
    whole = replace(whole, opacities=np.full_like(whole.opacities, 0.9))
    frames = []
    for n, camera in enumerate(whole.cameras):
        write_png(folder / f"{n}.png", Renderer(whole, 1).render(camera))
        frames.append(Frame(camera, folder / f"{n}.png"))
    wrong = replace(whole, sh=whole.sh + 0.2 * np.sin(np.arange(100) / 9)[:, None, None].astype(np.float32))
    return wrong, Scene(folder, tuple(frames), 1.0, 10.0)


def test_small_steps_gain_and_count(worn) -> None:
    stats = RefineStats()
    ts.refine(*worn, 6, stats=stats)
    assert 1 < stats.kept <= stats.steps <= 6 and stats.after > stats.before
    ts.refine(*worn, 1, stats=(alone := RefineStats()))
    assert stats.looks[-1][1] > alone.looks[-1][1]  # one at full size is not what gained
