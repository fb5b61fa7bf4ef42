"""Sources of windows: what masks leave out, and photos by size."""

from pathlib import Path

import numpy as np
import pytest
from measure.evaluation_scenes import NEAR_WINDOW, write_eval_scene

from tinysplat.measure.quality import Prepared, ProfileQp, Quality
from tinysplat.measure.subjects.cases import WindowJob
from tinysplat.measure.subjects.sources import find_sources
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.scene.pictures import write_png


@pytest.fixture
def scene(tmp_path: Path):
    (source,), lost = find_sources([write_eval_scene(tmp_path / "plane", [NEAR_WINDOW])])
    assert lost == []
    return source


def test_what_masks_leave_out_has_no_gaussians_and_is_not_judged(scene, tmp_path: Path) -> None:
    window = scene.windows()[0][0]
    before = scene.fingerprint(window)
    mask = np.full((48, 64), 255, np.uint8)
    mask[:, :20] = 0
    for i in range(4):
        write_png(scene.path / f"{i}.mask.png", mask)
    job = WindowJob(scene, window, "sweep", (48, 64))
    found = Prepared.of(job, Runtime(threads=1), Quality((ProfileQp("balanced", 0.0),)))
    assert scene.fingerprint(window) != before
    opacities, (photo,) = found.pictures.gaussians.opacities, found.shots.targets.images
    assert not opacities[:, :, :20].any() and opacities[:, :, 20:].any()
    assert np.isnan(photo[:, :20]).all() and not np.isnan(photo[:, 20:]).any()
