"""What `convert --check` says: the loss of a file by its own pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.formats.check import file_loss


def test_an_exact_file_loses_nothing(tmp_path: Path) -> None:
    made = make_smooth_gaussians(2, 24, 32, degree=1)
    ts.save_gaussians(tmp_path / "a.npz", made)
    loss = file_loss(tmp_path / "a.npz", made)
    assert loss.psnr == 150 and loss.views == 2 and loss.bytes == (tmp_path / "a.npz").stat().st_size


@pytest.mark.parametrize("kept", [True, False])
def test_the_loss_is_that_of_pictures_made_by_hand(tmp_path: Path, kept: bool) -> None:
    made = make_smooth_gaussians(2, 24, 32, degree=0)
    if not kept:  # without views, from around
        made = made.flat()
    darker = replace(made, sh=made.sh - np.float32(0.05))
    ts.save_gaussians(tmp_path / "a.npz", darker)
    loss = file_loss(tmp_path / "a.npz", made)
    if kept:
        pairs = [[ts.render(g, c, dilation="screen", order="depth") for g in (made, darker)] for c in made.cameras]
        mse = [np.mean((a - b) ** 2) for a, b in pairs]
        assert loss.psnr == pytest.approx(np.mean([-10 * np.log10(e) for e in mse]), abs=1e-3)
    assert loss.views and 0 < loss.psnr < 150
