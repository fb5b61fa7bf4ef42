"""Parts of the runtime's work are timed by name, each without those within it, and only while someone looks."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import find_profile
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.system import stopwatch
from tinysplat_runtime.system.stopwatch import Stopwatch, part, peak_rss_bytes, tally_nonzero, watched_parts

RUNTIME = ts.Runtime(threads=1)
BLENDING = {"blend: picking records", "blend: alphas", "blend: sums", "blend: rest"}
FRAME = {"projection", "colours", "depth order", "tiles of every splat", "lists by tile", *BLENDING}


@pytest.fixture(scope="module")
def gaussians() -> ts.Gaussians:
    return make_smooth_gaussians(2, 48, 64, degree=1)


def test_a_part_counts_what_no_part_within_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = iter([0.0, 2.0, 5.0, 12.0, 20.0, 24.0])
    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    with watched_parts() as parts:
        with part("outer"), part("inner"):
            pass
        with part("outer"):
            pass
    assert parts.seconds == {"outer": (12 - 0) - (5 - 2) + (24 - 20), "inner": 3}


def test_nobody_looking_is_nothing_timed() -> None:
    with watched_parts() as parts:
        pass
    with part("later"):
        tally_nonzero("later", np.ones(3))
    assert parts.seconds == parts.tallies == {}


def test_decoding_has_named_parts_that_come_to_no_more_than_the_whole(gaussians: ts.Gaussians) -> None:
    data = RUNTIME.compress(gaussians)
    start = time.perf_counter()
    with watched_parts() as parts:
        RUNTIME.decompress(data)
    whole = time.perf_counter() - start
    assert set(parts.seconds) == {"metadata", "CRC", "libavcodec", "copy of pictures", "synthesis graph"}
    assert 0.3 * whole < sum(parts.seconds.values()) <= whole


@pytest.mark.parametrize("compiled", [False, True])
def test_a_frame_has_named_parts(gaussians: ts.Gaussians, compiled: bool) -> None:
    renderer = Renderer(gaussians, 1, compiled=compiled)
    with watched_parts() as parts:
        renderer.render(gaussians.cameras[0])
    loops = {"projection and colours", "listing what is visible", "lists by tile", "sort and blend"}
    assert set(parts.seconds) == (loops if compiled else FRAME)
    assert bool(parts.tallies.get("alphas above 1/255")) is not compiled


def test_an_encoder_takes_another_plane_coder_and_shows_it_every_plane_once(gaussians: ts.Gaussians) -> None:
    calls = []

    def recording(codes, qp, settings, offsets):
        calls.append((codes, qp, settings, offsets))
        return encode_plane(codes, qp, settings, offsets)

    encoder = SceneEncoder(gaussians, find_profile("fast"), RUNTIME.store, threads=1, plane_coder=recording)
    data = encoder.code(encoder.plan(0), 0)
    assert data == RUNTIME.compress(gaussians, "fast")
    pictures = sum(len(plane.get("bytes_by_view", [])) for plane in ts.inspect(data)["planes"])
    assert len(calls) == pictures > 10
    encoder.code(encoder.plan(0), 0)
    assert len(calls) == pictures


def test_stages_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = iter([1.0, 3.5, 10.0, 10.25])
    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    watch = Stopwatch()
    with watch.stage("code"):
        pass
    with pytest.raises(ValueError), watch.stage("code"):
        raise ValueError
    watch.add("write", 2)
    assert watch.seconds == {"code": 2.75, "write": 2}


def test_tallies_add_up_what_is_not_zero() -> None:
    with watched_parts() as parts:
        tally_nonzero("alphas", np.array([[0, 2], [3, 0]]))
        tally_nonzero("alphas", np.array([True, False]))
    assert parts.tallies == {"alphas": 3}


@pytest.mark.parametrize(("platform", "expected"), [("linux", 5 * 1024), ("darwin", 5)])
def test_the_peak_is_in_bytes_on_every_system(monkeypatch: pytest.MonkeyPatch, platform: str, expected: int) -> None:
    usage = SimpleNamespace(RUSAGE_SELF=0, getrusage=lambda who: SimpleNamespace(ru_maxrss=5 + who))
    monkeypatch.setattr(stopwatch, "resource", usage)
    monkeypatch.setattr(stopwatch, "sys", SimpleNamespace(platform=platform))
    assert peak_rss_bytes() == expected
