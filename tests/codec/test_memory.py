"""What coding takes besides the Gaussians that it is given."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.job import EncodeStats, Job, PlaneCoder
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.inference import GraphStore

STORE = GraphStore()


def job_of(scene: Gaussians, profile: str, plane_coder: PlaneCoder | None = None) -> Job:
    return Job(scene, PROFILES[profile], 0, STORE, 1, EncodeStats(), plane_coder=plane_coder)


def test_of_a_capture_a_few_views_are_held() -> None:
    """Of their planes 60 bytes a pixel; what remains is a byte for each 16, and lists of pictures."""
    height, width = 384, 160
    plane = encode_plane(np.full((height, width), 2048, np.uint16), 20, PROFILES["balanced"].encoder)
    peaks = []
    for views in (7, 7, 14):  # the first loads what both need
        scene = make_smooth_gaussians(views, height, width, degree=0)
        tracemalloc.start()
        try:
            SceneEncoder(job_of(scene, "balanced", lambda *_: plane)).encode(0)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[2] - peaks[1] < 12 * 7 * height * width


def test_bytes_do_not_depend_on_where_arrays_lie(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, files = make_smooth_gaussians(9, 256, 160), []  # of which arrays exceed `LEAST_BYTES`
    for folder in (tmp_path, tmp_path / "missing"):  # without it, all lies in memory
        monkeypatch.setenv("TMPDIR", str(folder))
        files.append(SceneEncoder(job_of(scene, "fast")).encode(0))
    assert files[0] == files[1]
