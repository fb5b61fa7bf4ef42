"""Made-up scenes, the libraries alone, peers' formats and peak memory: what studies stand on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat.measure.clock import measure_peak
from tinysplat.measure.pictures import Drawing, Pictures, rescaled
from tinysplat.measure.rows import RowFile
from tinysplat.measure.studies.rate import compare_ways
from tinysplat.measure.study import Run
from tinysplat.measure.subjects.cases import Window
from tinysplat.measure.subjects.made import made_case
from tinysplat.measure.subjects.room import Room, photograph, room_cameras
from tinysplat.measure.tasks import PlaneRecorder, decode_alone, encode_alone, file_streams
from tinysplat.measure.ways import MissingToolError, Way, peer_ways
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import find_profile
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.gaussian.gaussians import FIELDS


def test_depths_of_the_room_agree_between_views() -> None:
    cameras = room_cameras(2, 48, 64)
    (_, depth), (_, other) = (photograph(camera) for camera in cameras)
    y, x = np.mgrid[:48, :64] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cameras[0].K).T
    world = (rays * depth[..., None]) @ cameras[0].rotation + cameras[0].centre
    seen = (world - cameras[1].centre) @ cameras[1].rotation.T
    pixel = (seen @ cameras[1].K.T)[..., :2] / seen[..., 2:]
    inside = ((pixel > 0) & (pixel < [64, 48])).all(axis=-1)
    column, row = pixel[inside].astype(int).T
    error = np.abs(other[row, column] - seen[inside][:, 2]) / seen[inside][:, 2]
    assert np.median(error) < 5e-3  # half a pixel of a slanted wall; more where one view sees what the other does not


def test_network_like_gaussians_show_their_photos() -> None:
    case = made_case(2, 64, 64, 1)
    figures = Pictures(case, Drawing()).figures(case.gaussians)
    assert figures["psnr_decoded_raw"] == 150
    assert figures["db_lost"] == 0
    assert figures["psnr_raw"] > 20


def test_rescaling_keeps_a_ramp() -> None:
    ramp = np.arange(8.0)[:, None, None] * np.ones((1, 6, 3))
    double = rescaled(ramp, 16, 12)
    assert double.shape == (16, 12, 3)
    assert np.allclose(double[4:-4, 0, 0], np.arange(3, 11) / 2 + 0.25, atol=1e-5)


def test_recorded_planes_are_those_of_the_file_and_can_be_coded_alone() -> None:
    gaussians, runtime, recorder = make_smooth_gaussians(2, 16, 16, 1), Runtime(threads=2), PlaneRecorder()
    data = encode_gaussians(
        gaussians, find_profile("balanced"), 0, runtime.store, threads=2, plane_coder=recorder
    )  # fmt: skip
    assert data == runtime.compress(gaussians)
    encode_alone(recorder.planes, threads=2)()
    streams = file_streams(data)
    assert len(streams) == len(recorder.planes) > 0
    for threads in (1, 2):
        decode_alone(streams, threads)()


def peer(name: str) -> Way:
    return next(way for way in peer_ways(Runtime(threads=1), 5) if way.name.startswith(name))


@pytest.mark.parametrize(("name", "tolerance"), [("PLY", 1e-5), ("float16", 2e-3)])
@pytest.mark.parametrize("degree", [0, 3])
def test_simple_peers_give_back_what_they_stored(name: str, tolerance: float, degree: int) -> None:
    gaussians = make_smooth_gaussians(2, 8, 12, degree).flat()
    unit = replace(gaussians, quats=gaussians.quats / np.linalg.norm(gaussians.quats, axis=-1, keepdims=True))
    case = replace(made_case(1, 16, 16, 0), gaussians=unit)
    decoded = peer(name).decode(case, peer(name).encode(case, 0.0))
    for field in FIELDS:
        assert np.abs(getattr(decoded, field) - getattr(unit, field)).max() < tolerance, field


def test_a_tool_that_is_missing_costs_its_row_and_says_so(tmp_path) -> None:
    def missing(*_: object) -> bytes:
        raise MissingToolError("xyz is not installed: pip install xyz")

    case = made_case(1, 16, 16, 0)
    run = Run(True, Runtime(threads=1), RowFile(tmp_path / "rows.jsonl"), tmp_path)
    ways = [Way("Xyz", (0.0,), missing, lambda *_: case.gaussians, tool="xyz"), peer("PLY")]
    rows = compare_ways("peers", case, ways, run, run.effort)
    assert [(row.study, row.way, row.seconds is None) for row in rows] == [
        ("peers encode", "Xyz", True),
        ("peers encode", "PLY", False),
        ("peers decode", "PLY", False),
    ]
    assert rows[0].note == "xyz is not installed: pip install xyz"


def test_peak_memory_grows_with_the_input_and_not_with_the_parent() -> None:
    ballast = np.ones(30_000_000)  # 240 MB that a child must not inherit
    task = "tinysplat.measure.tasks.render_once"
    small, large = (measure_peak(task, f"surface:2x{n}x{n}", "16x16", "numpy", 1) for n in (16, 160))
    assert small.before < small.total < ballast.nbytes
    assert large.total > small.total + 5_000_000


def test_a_child_that_fails_says_why(tmp_path) -> None:
    with pytest.raises(TinySplatError, match=r"missing\.npz"):
        measure_peak("tinysplat.measure.tasks.encode", tmp_path / "missing.npz", "balanced", 1)


def test_the_room_written_as_a_scene_is_the_room(tmp_path: Path) -> None:
    shots = Room(3).shots(Window("any", (0,), (1,)), (16, 24))
    Room(3).write(tmp_path, (16, 24))
    scene = ts.load_scene(tmp_path)
    assert (scene.near, scene.far) == (shots.near, shots.far) and len(scene.frames) == 3
    assert np.abs(scene.images() - shots.context.images).max() <= 0.5 / 255 + 1e-6
    for one, other in zip(scene.cameras, shots.context.cameras, strict=True):
        np.testing.assert_allclose(one.c2w, other.c2w)
        np.testing.assert_allclose(one.K, other.K)
    assert len(json.loads((tmp_path / "cameras.json").read_text())["frames"]) == 3
