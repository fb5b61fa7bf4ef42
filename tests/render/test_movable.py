"""Gaussians that move: their rows, what places them, and what they become."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")

from scenes import make_gaussians

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.render.gradient import MovableGaussians, Target
from tinysplat_runtime.render.kernels_place import SH_RED
from tinysplat_runtime.system.threads import Crew

RUN = Crew(1).map


def test_opacities_at_their_ends_stay_there_and_can_move() -> None:
    scene = make_gaussians(2, 2, 2, degree=0)
    opacities = scene.opacities.copy()
    opacities[0, 0] = 0, 1
    field = MovableGaussians(replace(scene, opacities=opacities), RUN)
    assert all(np.isfinite(field.values[:, grid.rows]).all() for grid in field.grids)
    found = field.gaussians(replace(scene, opacities=opacities))
    assert found.opacities[0, 0, 0] == 0 and found.opacities[0, 0, 1] == pytest.approx(1, abs=1e-3)


def test_what_is_drawn_follows_the_values_whatever_was_drawn_before() -> None:
    """Few views of a capture are drawn at a time, in memory that the next picture takes over."""
    scene = make_gaussians(9, 6, 7, degree=1)
    photo = np.zeros((6, 7, 3), np.float32)
    field = MovableGaussians(scene, RUN)
    shares = [field.shares(camera) for camera in scene.cameras]

    def seen(drawn: MovableGaussians, view: int) -> float:
        return drawn.measure(Target(scene.cameras[view], photo), shares=shares[view]).absolute

    first = [seen(field, view) for view in (0, 8, 0)]
    assert first[0] == first[2] != first[1]
    field.values[SH_RED:] += 1
    assert seen(field, 8) > first[1]
    assert seen(field, 0) == pytest.approx(seen(MovableGaussians(field.gaussians(scene), RUN), 0), rel=1e-4)


def test_what_lies_on_disk_moves_as_what_lies_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_gaussians(8, 120, 160, degree=1)
    photo = np.zeros((120, 160, 3), np.float32)

    def corrected(folder: Path) -> Gaussians:
        monkeypatch.setenv("TMPDIR", str(folder))
        field = MovableGaussians(scene, RUN)
        for camera in scene.cameras[::3] * 2:
            gradients = {grid: grid.zeros() for grid in field.grids[2:6]}
            field.measure(Target(camera, photo), shares=field.shares(camera), gradients=gradients)
            for grid, gradient in gradients.items():
                field.values[:, grid.rows] -= 1e-3 * gradient[:, : grid.height * grid.width]
        return field.gaussians(scene)

    on_disk, in_memory = corrected(tmp_path), corrected(tmp_path / "missing")
    assert (in_memory.sh != scene.sh).any()
    for name in FIELDS:
        assert (getattr(on_disk, name) == getattr(in_memory, name)).all()
