"""tsplat.js against `decompress`, file by file."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from conformance.run import CASES
from golden.cases import DATA
from hostile import corpus
from hostile.containers import Seed, changed
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from property.test_laws import PROFILE, captures, clouds
from scenes import list_in_tiers, make_list, make_smooth_gaussians
from sections import repacked
from web.node import Decoder

import tinysplat_runtime as ts
from tinysplat_runtime.codec.photos import decode_photos
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.cameras import intrinsics
from tinysplat_runtime.container.photos import Photos
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.gaussian.gaussians import FIELDS

BOUNDS = {"means": 1e-6, "quats": 2e-6, "scales": 1e-5, "opacities": 2e-6, "sh": 5e-6}
"""Of an array's largest value: onnxruntime's float32 beside doubles."""


def differences(found: dict[str, NDArray], wanted: ts.Gaussians, whole: ts.Gaussians) -> dict[str, float]:
    """Largest difference of each array, as a share of its largest value in the whole file."""
    flat, whole = wanted.flat(), whole.flat()
    assert np.array_equal(found["origin"], wanted.origin)
    for name in FIELDS:
        assert found[name].shape == getattr(flat, name).shape
    return {
        name: float(np.abs(found[name] - getattr(flat, name)).max() / np.abs(getattr(whole, name)).max())
        for name in FIELDS
    }


def check(found: dict[str, NDArray], wanted: ts.Gaussians, whole: ts.Gaussians | None = None) -> None:
    """Fail where an array is farther from the runtime's than `BOUNDS`; of a part of a file, `whole` is all of it."""
    assert {n: d for n, d in differences(found, wanted, whole or wanted).items() if not d <= BOUNDS[n]} == {}
    cameras = [[*intrinsics(c.K), *c.c2w.ravel()] for c in wanted.cameras]
    assert np.array_equal(found["cameras"], np.reshape(cameras, (-1, 21)))


@pytest.fixture(scope="module")
def runtime() -> ts.Runtime:
    """The runtime, on one thread."""
    return ts.Runtime(threads=1)


def held_to(decoder: Decoder, runtime: ts.Runtime, file: bytes, length: int, whole: ts.Gaussians) -> int:
    """Hold a prefix to Python's reading of it; how many Gaussians it has, 0 where it is refused."""
    said, found = decoder(file, maxBytes=length)
    try:
        wanted = runtime.decompress(file, max_bytes=length)
    except ts.FormatError:
        assert said["error"] == "TsplatError"
        return 0
    check(found, wanted, whole)
    return wanted.count


@pytest.mark.parametrize("name", ["degree1_balanced", "list_balanced", "tiers"])
def test_prefixes_decode_as_in_python_or_are_refused_as_there(decoder: Decoder, runtime: ts.Runtime, name: str) -> None:
    file = list_in_tiers(make_list(600, 1, np.random.default_rng(2)), 9.0)
    if name != "tiers":
        file = (DATA / f"{name}.tsplat").read_bytes()
    whole = runtime.decompress(file)
    counts = [held_to(decoder, runtime, file, n, whole) for n in range(900, len(file) + 400, 500)]
    assert counts[0] == 0 < counts[-1] and (name != "tiers" or len(set(counts)) > 2)  # refused at first; tier by tier


@pytest.mark.parametrize("dropped", [0, 1, 4, 5, 8, 9, 12, 13])
def test_every_flag_of_a_layer_counts_by_itself(decoder: Decoder, runtime: ts.Runtime, dropped: int) -> None:
    seed = Seed.of(runtime.compress(make_smooth_gaussians(2, 16, 16, 1), "balanced"))

    def drop(data: bytearray) -> None:
        assert data[10] & 15 == 13  # inverse depth, rotations relative to quaternions, a scale mix
        data[10] &= ~dropped
        start = end = L.LAYER_FIXED.size
        for _ in range(4):
            end += 1 + (4 if data[end] & 2 else 8) * (2 if data[end] & 1 else 1)
        mix = data[end : end + 48] if not dropped & 8 else b""
        data[start : end + 48] = (b"" if dropped & 4 else data[start:end]) + mix

    file = changed(seed, L.LAYER, drop)
    check(decoder(file)[1], runtime.decompress(file))


def test_long_lists_lie_in_tiles(decoder: Decoder, runtime: ts.Runtime) -> None:
    file = runtime.compress(make_list(9000, 0, np.random.default_rng(3)), "fast", keep_all=True)
    check(decoder(file)[1], runtime.decompress(file))


def test_a_damaged_tier_is_left_out_as_in_python(decoder: Decoder, runtime: ts.Runtime) -> None:
    made = list_in_tiers(make_list(600, 1, np.random.default_rng(2)), 9.0)
    data = bytearray(made)
    data[ts.inspect(made)["prefixes"][-2]["bytes"] - 5] ^= 1  # of the last tier's colours
    lost: list[str] = []
    wanted = runtime.decompress(bytes(data), lost=lost)
    assert 0 < wanted.count < 600 and lost
    said, found = decoder(bytes(data), recover=True)
    check(found, wanted, runtime.decompress(made))
    assert said["missing"] == lost


@given(
    g=st.one_of(captures(views=3, side=16), clouds()),
    profile=PROFILE,
    qp=st.sampled_from([-12, 0]),  # at coarser steps terms cancel in float32, which conformance cases allow for
    is_exact=st.booleans(),
)
@settings(max_examples=12)
def test_whatever_is_encoded_decodes_as_in_python(
    decoder: Decoder, runtime: ts.Runtime, g, profile, qp, is_exact
) -> None:
    g = replace(g, opacities=np.maximum(g.opacities, np.float32(0.02)))  # lists leave out what nobody sees
    options = {"lossless": True} if is_exact and g.cameras else {"profile": profile, "qp": qp, "keep_all": True}
    file = runtime.compress(g, **options)
    said, found = decoder(file)
    wanted = runtime.decompress(file)
    check(found, wanted)
    assert said["notes"] == {name: value for name, value in asdict(wanted.notes).items() if value}


def test_a_damaged_picture_is_refused_or_recovered_as_in_python(decoder: Decoder, runtime: ts.Runtime) -> None:
    data = bytearray((DATA / "degree1_balanced.tsplat").read_bytes())
    data[-20] ^= 1
    said, _ = decoder(bytes(data))
    assert said["error"] == "TsplatError" and said["section"]
    lost: list[str] = []
    wanted = runtime.decompress(bytes(data), lost=lost)
    said, found = decoder(bytes(data), recover=True)
    check(found, wanted, runtime.decompress((DATA / "degree1_balanced.tsplat").read_bytes()))
    assert said["missing"] == lost


def test_workers_give_what_one_thread_gives(decoder: Decoder, runtime: ts.Runtime) -> None:
    data = runtime.compress(make_smooth_gaussians(2, 96, 96, 1), "fast", -6)
    alone = decoder(data)[1]
    for _ in range((1 << 20) // len(data)):  # until workers are worth their start
        several = decoder(data, threads=2)[1]
    assert all(np.array_equal(alone[name], several[name]) for name in alone)


def test_a_network_that_is_given_makes_photos_gaussians(decoder: Decoder, runtime: ts.Runtime, tmp_path: Path) -> None:
    grouped = CASES / "groups" / "groups.tsplat"
    for data in (corpus.photo_file_seeds()[0].data, grouped.read_bytes()):
        hold_to_network(data, decoder, runtime, tmp_path)


def hold_to_network(data: bytes, decoder: Decoder, runtime: ts.Runtime, tmp_path: Path) -> None:
    """A file of photos, decoded with what the runtime's network makes of it."""
    predicted = runtime.decompress(data)
    layers = []
    for n, layer in enumerate(predicted.layers):
        for name in FIELDS:
            getattr(layer, name).tofile(tmp_path / f"{n}.{name}")
        names = ("fx", "fy", "cx", "cy", "skew")
        cameras = [
            {**dict(zip(names, intrinsics(c.K), strict=True)), "c2w": c.c2w.ravel().tolist()} for c in layer.cameras
        ]
        height, width = layer.opacities.shape[1:]
        layers.append({"height": height, "width": width, "degree": layer.degree, "cameras": cameras})
    (tmp_path / "layers.json").write_text(json.dumps({"layers": layers, "origin": predicted.origin.tolist()}))
    said, found = decoder(data, network=str(tmp_path))
    assert "error" not in said
    check(found, predicted)
    photos = read_container(data).body
    assert isinstance(photos, Photos)
    wanted = decode_photos(photos.photos, 1)
    with np.load(tmp_path / "photos.npz") as shown:
        assert np.abs(np.stack([shown[str(view)] for view in range(len(wanted))]) - wanted).max() < 1e-6
    asked = json.loads((tmp_path / "asked.json").read_text())
    assert asked == {"near": photos.network.near, "far": photos.network.far, "name": photos.network.name}


def test_some_views_are_decoded_as_they_are_in_the_whole_file(decoder: Decoder, runtime: ts.Runtime) -> None:
    data = runtime.compress(make_smooth_gaussians(9, 24, 32, 1, layers=2))
    check(decoder(data, views=[7, 2])[1], runtime.decompress(data, views=[7, 2]))


def test_exact_planes_come_whole_or_not_at_all(decoder: Decoder, runtime: ts.Runtime) -> None:
    data = runtime.compress(make_smooth_gaussians(1, 4, 5, 0), lossless=True)
    check(decoder(repacked(data))[1], runtime.decompress(data))
    for broken in (zlib.compress(bytes(10)), zlib.compress(bytes(10**7)), b"", b"no zlib"):
        assert decoder(repacked(data, change=lambda _, broken=broken: broken))[0]["error"] == "TsplatError"


def test_photos_without_a_network_are_refused(decoder: Decoder) -> None:
    said, _ = decoder(corpus.photo_file_seeds()[0].data)
    assert (said["error"], said["section"]) == ("TsplatError", "PHOT[0]")
