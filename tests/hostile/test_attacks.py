"""Attacks that were thought of, each with the defence it meets."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path

import av
import numpy as np
import pytest
from hostile import corpus
from hostile.containers import Part, Seed, changed, field, join, memory_of_decoding
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime import cli
from tinysplat_runtime.codec.hevc import PlaneDecoder
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.bounds import decoding_bytes
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, NumericError
from tinysplat_runtime.gaussian.planes import CODING_ORDER, PlaneClass
from tinysplat_runtime.scene.cameras import Camera


@pytest.fixture(scope="module")
def seed() -> Seed:
    return Seed.of(ts.compress(make_smooth_gaussians(2, 16, 16, 1), "balanced"))


@pytest.fixture(scope="module")
def fine() -> Seed:
    """A file with pictures of every class, where coarser steps leave some as numbers."""
    return Seed.of(ts.compress(make_smooth_gaussians(2, 16, 16, 1), "balanced", qp=-24))


# ---- sections, numbers -----------------------------------------------------------------------------------------------


def test_a_table_of_more_sections_than_the_format_allows_is_refused(seed: Seed) -> None:
    notes = [Part(b"XTRA", 0, n, b"") for n in range(L.MAX_SECTIONS - len(seed.parts) + 1)]
    read_container(join([*notes[:-1], *seed.parts]))
    with pytest.raises(FormatError):
        read_container(join([*notes, *seed.parts]))


NO_NUMBERS = (np.nan, np.inf, -np.inf)
FAR = (1e16, -1e300, 1.7e308)  # beyond what float64 resolves
NUMBERS = [
    (L.SCENE, "<f4", [4], NO_NUMBERS),
    (L.SCENE, "<f8", [8, 16, 24], (*NO_NUMBERS, *FAR)),  # the origin
    (L.LAYER, "<f4", range(14, 30, 4), NO_NUMBERS),
    (L.PICTURES, "<f4", [10, 14], NO_NUMBERS),  # of the first channel
]


@pytest.mark.parametrize(("kind", "code", "places", "values"), NUMBERS)
def test_numbers_that_arithmetic_cannot_take_are_refused_without_a_warning(
    seed: Seed, kind: bytes, code: str, places: Iterable[int], values: Iterable[float]
) -> None:
    for at, value in product(places, values):
        with pytest.raises(FormatError):
            read_container(changed(seed, kind, field(at, code, value)))


@pytest.mark.parametrize(
    ("columns", "values"),
    [
        (range(19), NO_NUMBERS),
        ([0, 1], (5e-324, 1e-300, 1e-45, 1e-7, 1e10, 1.7e308)),  # focal lengths
        ([2, 3, 4, *range(7, 19)], FAR),
        ([5, 6], (0.0, -1.0, 16.5, 65537.0, 1e300)),  # width and height
    ],
)
def test_no_camera_has_numbers_that_arithmetic_cannot_take(columns: Iterable[int], values: Iterable[float]) -> None:
    one = Seed.of(ts.compress(make_smooth_gaussians(1, 8, 8, 0), "fast"))
    (section,) = (part.data for part in one.parts if part.kind == L.CAMERAS)
    for column, value in product(columns, values):

        def change(data: bytearray, column: int = column, value: float = value) -> None:
            data.clear()
            at = 0
            for number in range(19):
                size = 4 if section[at] & 2 else 8
                own = section[at + 1 : at + 1 + size]
                data += struct.pack("<Bd", 0, value) if number == column else section[at : at + 1] + own
                at += 1 + size

        with pytest.raises(FormatError):
            read_container(changed(one, L.CAMERAS, change))


@pytest.mark.parametrize("change", [{"scale": 9e29}, {"offset": 9.9e29, "scale": 9e26}])
@pytest.mark.parametrize("plane_class", CODING_ORDER)
def test_values_that_are_in_range_each_but_overflow_together_are_refused(
    fine: Seed, plane_class: PlaneClass, change: dict[str, float]
) -> None:
    channel = next(c for c in read_container(fine.data).body.layers[0].channels if c.plane_class == plane_class)

    def write(data: bytearray) -> None:
        head = L.CHANNEL.pack(0, *channel.key, channel.qp, channel.scale, channel.offset)
        at, new = data.index(head), replace(channel, **change)
        data[at : at + len(head)] = L.CHANNEL.pack(0, *new.key, new.qp, new.scale, new.offset)

    with pytest.raises(FormatError):
        read_container(changed(fine, L.PICTURES, write))


def test_scenes_that_no_file_can_hold_are_refused_when_they_are_encoded() -> None:
    """Every Gaussian is in range; a file whose codes mix their depth and offset could decode to 1e32."""
    g = make_smooth_gaussians(1, 8, 8, 0)
    camera = Camera([[1e-6, 0, 4], [0, 1e-6, 4], [0, 0, 1]], np.eye(4), 8, 8)
    means = np.tile(np.float32([0, 0, 1]), (1, 8, 8, 1))
    means[0, 0, :, 2] = 1e13
    means[0, 1, :, 0] = 1e19
    scene = ts.Gaussians(means, g.quats, g.scales, g.opacities, g.sh, (camera,))
    with pytest.raises(NumericError):
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
    with pytest.raises(FormatError):
        PlaneDecoder(sets, 16, 16).decode_into(payload, np.empty((16, 16), np.uint16))


@pytest.mark.parametrize("depth_channels", [1, 60])
def test_decoding_takes_at_most_twice_the_memory_that_the_limit_counts(tmp_path: Path, depth_channels: int) -> None:
    g = make_smooth_gaussians(1, 400, 400, 0)
    seed = Seed.of(ts.compress(g, "fast"))
    pict, first = next(p for p in seed.parts if p.kind == L.PICTURES), seed.pict.places[0]
    more, head = depth_channels - 1, L.PICTURES_FIXED.size
    count, *rest = L.PICTURES_FIXED.unpack(pict.data[:head])
    entries = head + count * L.CHANNEL.size
    rows = pict.data[head : head + L.CHANNEL.size] * more + pict.data[head:entries]
    streams = pict.data[entries : entries + L.STREAM.size] * more + pict.data[entries:]
    table = L.PICTURES_FIXED.pack(count + more, *rest) + rows + streams
    pictures = seed.parts[-1].data[: first.length] * more + seed.parts[-1].data
    new = {L.PICTURES: table, L.DATA: pictures}
    data = join([replace(p, data=new.get(p.kind, p.data)) for p in seed.parts])
    grown = memory_of_decoding(tmp_path, corpus.tsplat_seeds()[0].data, data)
    assert grown <= 2 * decoding_bytes(read_container(data).body.layers[0])


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


def test_limits_of_the_command_line_reach_the_reader(tmp_path, capsys) -> None:
    (tmp_path / "f.tsplat").write_bytes(corpus.tsplat_seeds()[0].data)
    for option, value in (("--max-pixels", 34), ("--max-memory", 500)):
        for command in (["info"], ["decode", "-o", tmp_path / "g.npz"], ["render", "-o", tmp_path / "p.png"]):
            assert cli.main([str(a) for a in (command[0], tmp_path / "f.tsplat", *command[1:], option, value)]) == 2
            assert option in capsys.readouterr().err
