"""Attacks that were thought of, each with the defence it meets."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from hostile import corpus
from hostile.containers import Part, Seed, join
from scenes import make_smooth_gaussians, refusing

import tinysplat_runtime as ts
from tinysplat_runtime import cli
from tinysplat_runtime.codec.hevc import PlaneDecoder
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.bounds import decoding_bytes
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import ChannelRecord, Limits
from tinysplat_runtime.errors import FormatError, InputError, NumericError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.scene.cameras import Camera


@pytest.fixture(scope="module")
def seed() -> Seed:
    return Seed.of(ts.compress(make_smooth_gaussians(2, 16, 16, 1), "balanced"))


@pytest.fixture(scope="module")
def fine() -> Seed:
    """A file with pictures of every class, where coarser steps leave some as numbers."""
    return Seed.of(ts.compress(make_smooth_gaussians(2, 16, 16, 1), "balanced", qp=-24))


def _changed(seed: Seed, kind: bytes, change: Callable[[bytearray], None], index: int = 0) -> bytes:
    """The file with one section changed and every checksum right."""
    parts = list(seed.parts)
    at = next(i for i, p in enumerate(parts) if (p.kind, p.index) == (kind, index))
    data = bytearray(parts[at].data)
    change(data)
    parts[at] = replace(parts[at], data=bytes(data))
    return join(parts)


# ---- truncation, sections --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", range(len(corpus.tsplat_seeds())))
def test_a_file_cut_at_any_byte_is_refused_by_the_whole_decoder(number: int) -> None:
    data = corpus.tsplat_seeds()[number].data
    for length in range(len(data)):
        with pytest.raises(FormatError):
            ts.decompress(data[:length])


def test_sections_in_another_order_decode_to_the_same_gaussians(seed: Seed) -> None:
    turned = ts.decompress(join(sorted(seed.parts, key=lambda part: part.kind, reverse=True)))
    straight = ts.decompress(seed.data)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(turned, name), getattr(straight, name))


def test_a_flipped_bit_behind_a_repaired_section_checksum_is_still_seen(seed: Seed) -> None:
    for i, part in enumerate(seed.parts):
        if part.kind in L.PLANES.values():
            data = bytearray(part.data)
            data[len(data) // 2] ^= 1
            parts = [*seed.parts[:i], replace(part, data=bytes(data)), *seed.parts[i + 1 :]]
            with pytest.raises(FormatError, match="CRC differs"):
                ts.decompress(join(parts))


def test_a_table_of_more_sections_than_the_format_allows_is_refused(seed: Seed) -> None:
    notes = [Part(b"XTRA", 0, n, b"") for n in range(L.MAX_SECTIONS - len(seed.parts) + 1)]
    read_container(join([*seed.parts, *notes[:-1]]))
    with pytest.raises(FormatError, match="sections"):
        read_container(join([*seed.parts, *notes]))


# ---- numbers ---------------------------------------------------------------------------------------------------------


def _field(fields: tuple[int, str], value: float) -> Callable[[bytearray], None]:
    at, code = fields
    packed = np.array(value, code).tobytes()

    def change(data: bytearray) -> None:
        data[at : at + len(packed)] = packed

    return change


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_number_of_the_metadata_may_be_nan_or_infinite(seed: Seed, value: float) -> None:
    floats = {
        L.SCENE: [(4, "<f4"), *((8 + 8 * i, "<f8") for i in range(3))],
        L.CAMERAS: [(8 * i, "<f8") for i in range(2 * 17)],
        L.LAYER: [(16 + 4 * i, "<f4") for i in range(4)],
    }
    for kind, fields in floats.items():
        for field in fields:
            with pytest.raises(FormatError):
                read_container(_changed(seed, kind, _field(field, value)))


def test_reference_rotations_scale_mixes_bases_and_channels_may_not_hold_nan(seed: Seed) -> None:
    size = len(next(p for p in seed.parts if p.kind == L.LAYER).data)
    channel_from = size - sum(
        L.CHANNEL.size + L.STREAM.size * len(c.streams) for c in read_container(seed.data).body.layers[0].channels
    )
    for at in (*range(L.LAYER_FIXED.size, channel_from - 3, 4), channel_from + 4, channel_from + 8):
        with pytest.raises(FormatError):
            read_container(_changed(seed, L.LAYER, _field((at, "<f4"), np.nan)))


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (lambda c: replace(c, scale=9e29), "can decode to"),
        (lambda c: replace(c, offset=9.9e29, scale=9e26), "can decode to"),
    ],
)
@pytest.mark.parametrize("plane_class", list(PlaneClass))
def test_values_that_are_in_range_each_but_overflow_together_are_refused(
    fine: Seed, plane_class: PlaneClass, change: Callable[[ChannelRecord], ChannelRecord], names: str
) -> None:
    channel = next(c for c in read_container(fine.data).body.layers[0].channels if c.plane_class == plane_class)

    def write(data: bytearray) -> None:
        head = L.CHANNEL.pack(plane_class, channel.target, L.INTRA, channel.qp, channel.scale, channel.offset)
        at, new = data.index(head), change(channel)
        data[at : at + len(head)] = L.CHANNEL.pack(plane_class, new.target, L.INTRA, new.qp, new.scale, new.offset)

    with pytest.raises(FormatError, match=names):
        read_container(_changed(fine, L.LAYER, write))


@pytest.mark.parametrize("field", [0, 1])
@pytest.mark.parametrize("focal", [5e-324, 1e-300, 1e-45, 1e-7, 1e10, 1.7e308])
def test_focal_lengths_that_float32_arithmetic_cannot_take_are_refused(seed: Seed, field: int, focal: float) -> None:
    with pytest.raises(FormatError, match=r"focal|at most"):
        read_container(_changed(seed, L.CAMERAS, _field((8 * field, "<f8"), focal)))


@pytest.mark.parametrize("value", [1e16, -1e300, 1.7e308])
def test_positions_beyond_what_float64_resolves_are_refused_without_a_warning(seed: Seed, value: float) -> None:
    for at in (*range(5, 17), *range(2, 5)):
        with pytest.raises(FormatError):
            read_container(_changed(seed, L.CAMERAS, _field((8 * at, "<f8"), value)))
    with pytest.raises(FormatError, match="origin"):
        read_container(_changed(seed, L.SCENE, _field((8, "<f8"), value)))
    with pytest.raises(InputError, match="c2w"):
        c2w = np.eye(4)
        c2w[0, 3] = value
        Camera(np.eye(3), c2w, 4, 4)


def test_reference_rotations_whose_length_overflows_are_refused_without_a_warning(seed: Seed) -> None:
    for value in (1e30, -3e38):
        with pytest.raises(FormatError, match="length 1"):
            read_container(_changed(seed, L.LAYER, _field((L.LAYER_FIXED.size, "<f4"), value)))


@pytest.mark.parametrize("name", FIELDS)
def test_float64_beyond_float32_is_refused_by_name_without_a_warning(name: str) -> None:
    g = make_smooth_gaussians(1, 2, 2, 0)
    arrays = {field: getattr(g, field).astype(np.float64) for field in FIELDS}
    arrays[name][0, 1, 1] = 1e39
    with refusing(InputError, name):
        ts.Gaussians(**arrays, cameras=g.cameras)


def test_scenes_that_no_file_can_hold_are_refused_when_they_are_encoded() -> None:
    """Every Gaussian is in range; a file whose codes mix their depth and offset could decode to 1e32."""
    g = make_smooth_gaussians(1, 8, 8, 0)
    camera = Camera([[1e-6, 0, 4], [0, 1e-6, 4], [0, 0, 1]], np.eye(4), 8, 8)
    means = np.tile(np.float32([0, 0, 1]), (1, 8, 8, 1))
    means[0, 0, :, 2] = 1e13
    means[0, 1, :, 0] = 1e19
    scene = ts.Gaussians(means, g.quats, g.scales, g.opacities, g.sh, (camera,))
    with pytest.raises(NumericError, match="what a file can hold"):
        ts.compress(scene, "paper")


# ---- pictures --------------------------------------------------------------------------------------------------------


def _stream(width: int, height: int, pixel_format: str) -> tuple[bytes, bytes]:
    """(parameter sets, slice) of a picture that is valid HEVC, but not what the container promises."""
    context = av.CodecContext.create("libx265", "w")
    context.width, context.height, context.pix_fmt = width, height, pixel_format
    context.time_base, context.framerate = Fraction(1, 25), Fraction(25)
    context.options = {"x265-params": "log-level=none:info=0:keyint=1"}
    frame = av.VideoFrame(width, height, pixel_format)
    for plane in frame.planes:
        plane.update(bytes(plane.buffer_size))
    frame.pts = 0
    data = b"".join(bytes(p) for p in (*context.encode(frame), *context.encode(None)))
    units = [u.rstrip(b"\0") for u in data.split(b"\0\0\1")[1:]]
    sets = b"".join(b"\0\0\0\1" + u for u in units if (u[0] >> 1) & 63 in (32, 33, 34))
    return sets, next(u for u in units if (u[0] >> 1) & 63 in (19, 20))


@pytest.mark.parametrize(
    ("width", "height", "pixel_format"),
    [
        (16, 16, "gray"),
        (16, 16, "gray10le"),
        (16, 16, "yuv420p"),
        (16, 16, "yuv420p12le"),
        (16, 16, "yuv444p12le"),
        (32, 16, "gray12le"),
        (16, 32, "gray12le"),
        (24, 24, "gray12le"),
        (1024, 512, "gray12le"),
    ],
)
def test_streams_of_another_size_depth_or_chroma_than_the_header_says_are_refused(
    width: int, height: int, pixel_format: str
) -> None:
    sets, payload = _stream(width, height, pixel_format)
    out = np.full((16, 16), 7, np.uint16)
    with pytest.raises(FormatError):
        PlaneDecoder(sets, 16, 16).decode_into(payload, out)
    assert (out == 7).all()


def test_more_pictures_than_memory_allows_are_refused_before_any_is_decoded(seed: Seed) -> None:
    """The codes of 256 depth channels would outweigh the Gaussians ten times."""
    layer = read_container(seed.data).body.layers[0]
    many = replace(layer, channels=tuple(layer.channels[:1]) * 256)
    assert decoding_bytes(many) > 256 * 2 * layer.gaussians
    with pytest.raises(FormatError, match="max-memory"):
        read_container(seed.data, Limits(max_memory_bytes=decoding_bytes(layer) - 1))
    read_container(seed.data, Limits(max_memory_bytes=decoding_bytes(layer)))


_PEAK = """
import resource, sys
import tinysplat_runtime as ts
small = open(sys.argv[1], "rb").read()
runtime = ts.Runtime(threads=2)
runtime.decompress(small)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
runtime.decompress(open(sys.argv[2], "rb").read())
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
"""


@pytest.mark.parametrize("depth_channels", [1, 60])
def test_decoding_takes_at_most_twice_the_memory_that_the_limit_counts(tmp_path: Path, depth_channels: int) -> None:
    g = make_smooth_gaussians(1, 400, 400, 0)
    seed = Seed.of(ts.compress(g, "fast"))
    layer = next(p for p in seed.parts if p.kind == L.LAYER)
    channels = read_container(seed.data).body.layers[0].channels
    record = L.CHANNEL.size + L.STREAM.size
    head = len(layer.data) - sum(L.CHANNEL.size + L.STREAM.size * len(c.streams) for c in channels)
    repeated = layer.data[head : head + record] * (depth_channels - 1)
    fixed = list(L.LAYER_FIXED.unpack(layer.data[: L.LAYER_FIXED.size]))
    fixed[6] += depth_channels - 1
    data = L.LAYER_FIXED.pack(*fixed) + layer.data[L.LAYER_FIXED.size : head] + repeated + layer.data[head:]
    first = channels[0].streams[0].length
    depth = next(p for p in seed.parts if (p.kind, p.index) == (L.PLANES[PlaneClass.DEPTH], 0))
    changed = {layer: data, depth: depth.data[:first] * (depth_channels - 1) + depth.data}
    parts = [replace(p, data=changed.get(p, p.data)) for p in seed.parts]
    (tmp_path / "large").write_bytes(join(parts))
    (tmp_path / "small").write_bytes(corpus.tsplat_seeds()[0].data)
    command = [sys.executable, "-c", _PEAK, str(tmp_path / "small"), str(tmp_path / "large")]
    grown = int(subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout)
    assert grown <= 2 * decoding_bytes(read_container(join(parts)).body.layers[0])


# ---- the command line ------------------------------------------------------------------------------------------------


def _run(arguments: Sequence[object], capsys: pytest.CaptureFixture[str]) -> None:
    status = cli.main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    assert status in (0, 2), err
    assert "Traceback" not in err
    if status == 2:
        assert out == "" and err.count("\n") == 1, (out, err)


def test_no_damaged_file_brings_a_traceback_or_more_than_one_line(tmp_path, capsys) -> None:
    rng = np.random.default_rng(0)
    seeds = corpus.tsplat_seeds()
    for number in range(24):
        data = bytearray(seeds[number % len(seeds)].data)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        (tmp_path / "f.tsplat").write_bytes(data)
        _run(["info", tmp_path / "f.tsplat", "--json"], capsys)
        _run(["decode", tmp_path / "f.tsplat", "-o", tmp_path / "g.npz", "--force"], capsys)
        _run(["render", tmp_path / "f.tsplat", "-o", tmp_path / "p.png", "--force"], capsys)
    for suffix in (".npz", ".safetensors", ".ply"):
        for number in range(8):
            data = bytearray(corpus.gaussian_seeds(suffix)[number % 3])
            data[rng.integers(len(data))] ^= 1 << rng.integers(8)
            (tmp_path / f"g{suffix}").write_bytes(data)
            _run(["compress", tmp_path / f"g{suffix}", "-o", tmp_path / "f.tsplat", "--force"], capsys)


def test_info_of_an_accepted_file_is_strict_json(capsys, tmp_path) -> None:
    for seed in corpus.tsplat_seeds():
        (tmp_path / "f.tsplat").write_bytes(seed.data)
        assert cli.main(["info", str(tmp_path / "f.tsplat"), "--json"]) == 0
        json.loads(capsys.readouterr().out, parse_constant=lambda name: pytest.fail(f"JSON holds {name}"))


def test_limits_of_the_command_line_reach_the_reader(tmp_path, capsys) -> None:
    (tmp_path / "f.tsplat").write_bytes(corpus.tsplat_seeds()[0].data)
    for option, value in (("--max-pixels", 34), ("--max-memory", 500)):
        for command in (["info"], ["decode", "-o", tmp_path / "g.npz"], ["render", "-o", tmp_path / "p.png"]):
            assert cli.main([str(a) for a in (command[0], tmp_path / "f.tsplat", *command[1:], option, value)]) == 2
            assert option in capsys.readouterr().err
