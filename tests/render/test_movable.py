"""Gaussians that move: their rows, what places them, and what they become."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")

from scenes import make_gaussians

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.render.gradient import MovableGaussians, Target
from tinysplat_runtime.system.threads import Crew

RUN = Crew(1).map


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
