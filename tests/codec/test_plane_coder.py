"""An encoder codes its planes by what it is given."""

from __future__ import annotations

from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import find_profile

RUNTIME = ts.Runtime(threads=1)


def test_an_encoder_takes_another_plane_coder_and_shows_it_every_plane_once() -> None:
    gaussians = make_smooth_gaussians(2, 48, 64, degree=1)
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
