"""Made-up scenes, peers' formats and peak memory: what the benchmarks stand on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians, write_scene

from tinysplat.bench import peers
from tinysplat.bench.dressing import blur
from tinysplat.bench.inputs import Motorcycle, Room, made_case, made_gaussians, truncated, user_inputs
from tinysplat.bench.judge import Judge
from tinysplat.bench.memory import peak_of_gaussians
from tinysplat.bench.rasteriser import enlarged
from tinysplat.bench.room import photograph, room_cameras
from tinysplat.bench.streams import decode_alone, encode_alone, file_streams, recorded_planes
from tinysplat.bench.timing import Effort
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians


def test_the_same_room_is_made_every_time() -> None:
    made_gaussians.cache_clear()
    first = made_gaussians(2, 16, 24, 2)
    made_gaussians.cache_clear()
    again = made_gaussians(2, 16, 24, 2)
    assert all((getattr(first, name) == getattr(again, name)).all() for name in FIELDS)


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
    figures = Judge(case, threads=1).figures(case.gaussians)
    assert figures["psnr_decoded_raw"] == np.inf
    assert figures["db_lost"] == 0
    assert figures["psnr_raw"] > 20


def test_motorcycle_depth_lies_in_its_range() -> None:
    photos = Motorcycle().context(64, 64)
    assert photos.images.shape == (2, 64, 64, 3)
    assert photos.depths is not None
    known = photos.depths[0][photos.depths[0] > 0]
    near, far = Motorcycle().depth_range
    assert known.size > 2000
    assert near < np.quantile(known, 0.01)
    assert np.quantile(known, 0.99) < far


def test_blur_keeps_constants_and_the_interior_of_a_ramp() -> None:
    ramp = np.arange(40.0)[:, None] * np.ones((1, 30))
    assert np.allclose(blur(np.full((20, 30), 3.0), 2.5), 3)
    assert np.allclose(blur(ramp, 2.0)[10:30], ramp[10:30])


def test_enlarging_keeps_a_ramp() -> None:
    ramp = np.arange(8.0)[:, None, None] * np.ones((1, 6, 3))
    double = enlarged(ramp)
    assert double.shape == (16, 12, 3)
    assert np.allclose(double[1:-1, 0, 0], np.arange(14) / 2 + 0.25)


def test_recorded_planes_are_those_of_the_file_and_can_be_coded_alone() -> None:
    gaussians = make_smooth_gaussians(2, 16, 16, 1)
    with recorded_planes() as planes:
        data = Runtime(threads=2).compress(gaussians)
    encode_alone(planes, threads=2)()
    streams = file_streams(data)
    assert len(streams) == len(planes) > 0
    for threads in (1, 2):
        decode_alone(streams, threads)()


def peer(name: str) -> peers.Format:
    return next(f for f in peers.peer_formats(Runtime(threads=1), 5) if f.name.startswith(name))


@pytest.mark.parametrize(("name", "tolerance"), [("PLY", 1e-5), ("float16", 2e-3)])
@pytest.mark.parametrize("degree", [0, 3])
def test_simple_peers_give_back_what_they_stored(name: str, tolerance: float, degree: int) -> None:
    gaussians = make_smooth_gaussians(2, 8, 12, degree).flat()
    unit = replace(gaussians, quats=gaussians.quats / np.linalg.norm(gaussians.quats, axis=-1, keepdims=True))
    decoded = peer(name).decode(peer(name).encode(unit))
    for field in FIELDS:
        assert np.abs(getattr(decoded, field) - getattr(unit, field)).max() < tolerance, field


def test_a_tool_that_is_missing_costs_its_row_and_says_so() -> None:
    def missing(_: Gaussians) -> bytes:
        raise peers.MissingToolError("xyz is not installed: pip install xyz")

    case = made_case(1, 16, 16, 0)
    formats = [peers.Format("Xyz", "xyz", missing, lambda _: case.gaussians), peer("PLY")]
    rows = peers.peer_rows(case, Judge(case, 1), formats, Effort(1, 0, 1))
    assert [(row.stage, row.variant, row.seconds is None) for row in rows] == [
        ("peers encode", "Xyz", True),
        ("peers encode", "PLY", False),
        ("peers decode", "PLY", False),
    ]
    assert rows[0].note == "xyz is not installed: pip install xyz"


def test_peak_memory_grows_with_the_input_and_not_with_the_parent() -> None:
    ballast = np.ones(30_000_000)  # 240 MB that a child must not inherit
    small = peak_of_gaussians("render", made_gaussians(1, 16, 16, 0), "16x16", threads=1)
    large = peak_of_gaussians("render", made_gaussians(2, 160, 160, 3), "16x16", threads=1)
    assert small.before < small.total < ballast.nbytes
    assert large.total > small.total + 5_000_000


def test_a_child_that_fails_says_why() -> None:
    with pytest.raises(TinySplatError, match="belong to no pixels"):
        peak_of_gaussians("encode", made_gaussians(1, 16, 16, 0).flat(), "balanced", threads=1)


def test_truncation_cuts_bands_and_nothing_else() -> None:
    gaussians = made_gaussians(1, 16, 16, 2)
    cut = truncated(gaussians, 1)
    assert cut.degree == 1
    assert (cut.sh == gaussians.sh[..., :4, :]).all()
    assert cut.means is gaussians.means


def test_inputs_without_an_index_are_left_out_with_the_reason(tmp_path) -> None:
    scene = write_scene(tmp_path / "bare")
    with pytest.raises(InputError, match=r"eval_index\.json"):
        user_inputs([scene])
    (tmp_path / "good").mkdir()
    good = write_scene(tmp_path / "good" / "scene")
    (good / "eval_index.json").write_text('{"windows": [{"kind": "near", "context": [0, 2], "target": [1]}]}')
    scenes, files, left_out = user_inputs([scene, good])
    assert [s.window.context for s in scenes] == [(0, 2)]
    assert not files
    assert len(left_out) == 1
    assert Room().context(16, 16).images.shape == (2, 16, 16, 3)
