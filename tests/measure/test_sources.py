"""Sources of windows: stamps that follow what figures depend on, targets of Gaussian files, and photos by size."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from measure.evaluation_scenes import NEAR_WINDOW, write_eval_scene
from scenes import make_smooth_gaussians, refusing

from tinysplat.measure.subjects.cases import Window
from tinysplat.measure.subjects.sources import FileSource, find_sources
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import save_gaussians
from tinysplat_runtime.scene.pictures import write_png


@pytest.fixture
def scene(tmp_path: Path):
    (source,), lost = find_sources([write_eval_scene(tmp_path / "plane", [NEAR_WINDOW])])
    assert lost == []
    return source


@pytest.mark.parametrize("views", [1, 2, 3])
def test_a_gaussian_file_is_judged_midway_between_its_views(tmp_path: Path, views: int) -> None:
    gaussians = make_smooth_gaussians(views, 8, 12, 0)
    save_gaussians(tmp_path / "g.npz", gaussians)
    source = FileSource(tmp_path / "g.npz")
    case = source.case(Window("file", (), ()), "", (1, 1), None)  # type: ignore[arg-type]
    centres = np.array([camera.centre for camera in gaussians.cameras])
    wanted = (centres[1:] + centres[:-1]) / 2 if views > 1 else centres
    np.testing.assert_allclose([camera.centre for camera in case.cameras], wanted, atol=1e-6)
    count = max(views - 1, 1)
    assert source.windows() == ([Window("file", tuple(range(views)), tuple(range(count)))], [])
    assert (source.name, case.name, case.model, len(case.photos)) == ("g", "g", "g", count)
    before = source.fingerprint(source.windows()[0][0])
    os.utime(source.path, ns=(0, 7))
    assert source.fingerprint(source.windows()[0][0]) != before
    with refusing(InputError, str(tmp_path / "g.npz")):
        source.shots(Window("file", (), ()), (8, 8))


def test_a_file_without_cameras_has_no_targets(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "g.npz", make_smooth_gaussians(2, 8, 12, 0).flat())
    with refusing(InputError, f"{tmp_path / 'g.npz'} K c2w"):
        FileSource(tmp_path / "g.npz").windows()


def test_what_masks_leave_out_has_no_gaussians_and_is_not_judged(scene, tmp_path: Path) -> None:
    window = scene.windows()[0][0]
    before = scene.fingerprint(window)
    mask = np.full((48, 64), 255, np.uint8)
    mask[:, :20] = 0
    for i in range(4):
        write_png(scene.path / f"{i}.mask.png", mask)
    case = scene.case(window, "sweep", (48, 64), Runtime(threads=1))
    assert scene.fingerprint(window) != before
    assert not case.gaussians.opacities[:, :, :20].any() and case.gaussians.opacities[:, :, 20:].any()
    (photo,) = case.photos
    assert photo is not None and np.isnan(photo[:, :20]).all() and not np.isnan(photo[:, 20:]).any()
