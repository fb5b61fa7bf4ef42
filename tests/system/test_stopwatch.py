"""Parts of the runtime's work are timed by name, each without those within it, and only while someone looks."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import find_profile
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.system.stopwatch import part, tally_nonzero, watched_parts

RUNTIME = ts.Runtime(threads=1)
BLENDING = {"blend: picking records", "blend: alphas", "blend: sums", "blend: rest"}
FRAME = {"projection", "colours", "depth order", "tiles of every splat", "lists by tile", *BLENDING}


@pytest.fixture(scope="module")
def gaussians() -> ts.Gaussians:
    return make_smooth_gaussians(2, 48, 64, degree=1)


def test_a_part_counts_what_no_part_within_it_does(clock: Any) -> None:
    with watched_parts() as parts:
        with part("outer"):
            clock.sleep(2)
            with part("inner"):
                clock.sleep(3)
            clock.sleep(7)
        with part("outer"):
            clock.sleep(4)
    assert parts.seconds == {"outer": 2 + 7 + 4, "inner": 3}


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
