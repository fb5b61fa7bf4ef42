"""Attacks on files of mode free, one by one: what fuzzing finds by chance, and what it never would."""

from __future__ import annotations

import lzma
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hostile.containers import Seed, join
from scenes import free_in_tiers, make_free_gaussians
from sections import file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.codec.free import octree
from tinysplat_runtime.codec.free.octree import decode_points, encode_points, morton_keys
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.free import FREE, FREE_FIXED, FREE_TIER, TIER_FIXED, decoding_bytes
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import Limits
from tinysplat_runtime.errors import FormatError


@pytest.fixture(scope="module")
def seed() -> Seed:
    return Seed.of(ts.compress(make_free_gaussians(400, 1, np.random.default_rng(3)), qp=-12.0, keep_all=True))


def changed(seed: Seed, kind: bytes, change: Callable[[bytearray], None]) -> bytes:
    """The file with one section changed and every checksum right."""
    parts = list(seed.parts)
    at = next(i for i, p in enumerate(parts) if p.kind == kind)
    data = bytearray(parts[at].data)
    change(data)
    parts[at] = replace(parts[at], data=bytes(data))
    return join(parts)


def field(at: int, code: str, value: float) -> Callable[[bytearray], None]:
    packed = np.array(value, code).tobytes()

    def change(data: bytearray) -> None:
        data[at : at + len(packed)] = packed

    return change


FIXED = {
    "count": (0, "<u4", (0, 0xFFFFFFFF)),
    "degree": (4, "u1", (5, 255)),
    "levels": (5, "u1", (0, 22)),
    "channels": (6, "<u2", (0, 6, 7, 20, 65535)),
    "k": (8, "<u2", (0, 13, 65535)),
    "leaves": (16, "<u4", (0, 401, 0xFFFFFFFF)),
    "escapes": (20, "<u4", (401, 0xFFFFFFFF)),
    "centre": (24, "<f8", (np.nan, np.inf, 1e31)),
    "radius": (48, "<f8", (np.nan, np.inf, 0, -1, 1e31, 1e29)),
    "cell": (56, "<f8", (np.nan, np.inf, 0, -1, 1.5)),
    "low": (64, "<f8", (np.nan, np.inf, 70, -70)),
    "size_middle": (88, "<f4", (np.nan, np.inf, 70)),
}


@pytest.mark.parametrize("name", FIXED)
def test_no_field_may_be_what_it_must_not(seed: Seed, name: str) -> None:
    at, code, values = FIXED[name]
    for value in values:
        with pytest.raises(FormatError):
            read_container(changed(seed, FREE, field(at, code, value)))


def _places(seed: Seed) -> dict[str, int]:
    """Offsets of what stands behind the fixed fields."""
    scene = read_container(seed.data).body.scene
    assert scene is not None
    at = {"sizes": FREE_FIXED.size}
    at["streams"] = at["sizes"] + 4 * len(scene.tiers[0].grid.levels)
    at["thresholds"] = at["streams"] + L.STREAM.size * len(scene.tiers[0].grid.streams)
    at["orders"] = at["thresholds"] + sum(2 + 4 * len(values) for values in scene.thresholds)
    at["mean"] = at["orders"] + sum(4 + 4 * len(order.gains) for order in scene.orders)
    at["basis"] = at["mean"] + 4 * len(scene.mean)
    at["records"] = at["basis"] + scene.basis.nbytes
    return at


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_number_behind_them_may_be_nan_or_infinite(seed: Seed, value: float) -> None:
    at = _places(seed)
    floats = [(at["thresholds"] + 2, "<f4"), (at["thresholds"] + 6, "<f4"), (at["orders"] + 4, "<f4")]
    floats += [(at["mean"], "<f4"), (at["basis"], "<f2")]
    floats += [(at["records"] + offset, "<f4") for offset in (4, 8, 12)]
    for place, code in floats:
        with pytest.raises(FormatError):
            read_container(changed(seed, FREE, field(place, code, value)))


@pytest.mark.parametrize(
    ("place", "code", "value", "found"),
    [
        ("sizes", "<u4", 2, "do not grow as an octree's"),
        ("sizes", "<u4", 0, "do not grow as an octree's"),
        ("thresholds", "<u2", 256, "256 thresholds, at most 255"),
        ("records", "u1", 2, "class 2, channel 0; expected color0"),
        ("mean", "<f4", 1e31, "sh can decode to"),
    ],
)
def test_what_stands_behind_them_is_checked(seed: Seed, place: str, code: str, value: float, found: str) -> None:
    with pytest.raises(FormatError, match=found):
        read_container(changed(seed, FREE, field(_places(seed)[place], code, value)))


def test_orders_without_gains_and_thresholds_that_fall_are_refused(seed: Seed) -> None:
    at = _places(seed)
    with pytest.raises(FormatError, match="thresholds do not rise"):
        read_container(changed(seed, FREE, field(at["thresholds"] + 2, "<f4", 5.0)))

    def no_gains(data: bytearray) -> None:
        (count,) = np.frombuffer(data, "<u2", 1, at["orders"] + 2)
        del data[at["orders"] + 4 : at["orders"] + 4 + 4 * int(count)]
        data[at["orders"] + 2 : at["orders"] + 4] = b"\0\0"

    with pytest.raises(FormatError, match="an order without gains"):
        read_container(changed(seed, FREE, no_gains))


@pytest.mark.parametrize(("number", "found"), [(32, ""), (33, "33 gains, at most 32")])
def test_an_order_has_at_most_32_gains(seed: Seed, number: int, found: str) -> None:
    at = _places(seed)["orders"]

    def gains(data: bytearray) -> None:
        (count,) = np.frombuffer(data, "<u2", 1, at + 2)
        more = np.ones(number - int(count), "<f4").tobytes()
        data[at + 2 : at + 4] = np.array(number, "<u2").tobytes()
        data[at + 4 : at + 4] = more

    if not found:
        assert read_container(changed(seed, FREE, gains)).mode == "free"
        return
    with pytest.raises(FormatError, match=found):
        read_container(changed(seed, FREE, gains))


def test_views_and_layers_have_no_place_beside_them(seed: Seed) -> None:
    for at in (0, 2):
        with pytest.raises(FormatError, match="of Gaussians without pixels"):
            read_container(changed(seed, L.SCENE, field(at, "<u2", 1)))


def test_numbers_that_are_in_range_each_but_overflow_together_are_refused(seed: Seed) -> None:
    """An order's gain multiplies a channel's numbers, and the radius a logarithm's."""
    at = _places(seed)
    with pytest.raises(FormatError, match="can decode to"):
        read_container(changed(seed, FREE, field(at["orders"] + 4, "<f4", 9e29)))
    far = field(48, "<f8", 1e10), field(64, "<f8", 60.0)
    with pytest.raises(FormatError, match="positions can decode to more than 1e30"):
        read_container(changed(seed, FREE, lambda data: [f(data) for f in far]))  # type: ignore[arg-type, return-value]


def test_altered_positions_are_refused_by_their_checksum(seed: Seed) -> None:
    with pytest.raises(FormatError, match="stream 0 of the positions was altered"):
        read_container(changed(seed, b"FREP", lambda data: data.__setitem__(3, data[3] ^ 1)))


def test_bytes_behind_the_streams_of_positions_are_refused(seed: Seed) -> None:
    with pytest.raises(FormatError, match=r"\d+ bytes of positions, \d+ announced"):
        read_container(changed(seed, b"FREP", lambda data: data.append(0)))


@pytest.mark.parametrize(("count", "is_paid"), [(1, True), (256, True), (257, False), (9000, False)])
def test_a_byte_of_a_file_stands_for_256_gaussians_at_most(count: int, is_paid: bool, seed: Seed) -> None:
    """Equal Gaussians in one place take next to no bytes, but memory as any others do."""
    at = sum(len(part.data) for part in seed.parts)
    data = changed(seed, FREE, field(0, "<u4", count * at))
    found = "points, announced" if is_paid else f"the file's bytes stand for {256 * at} at most"
    with pytest.raises(FormatError, match=found):
        ts.decompress(data)


def test_memory_is_counted_as_the_page_has_it() -> None:
    """By hand: 4·(11 + d) of Gaussians, 2·(7 + k) of codes, 8·(16 + k) of numbers, 64 of the octree."""
    assert decoding_bytes(1000, 0, 0) == 1000 * (4 * 14 + 2 * 7 + 8 * 16 + 64)
    assert decoding_bytes(10, 3, 20) == 10 * (4 * 59 + 2 * 27 + 8 * 36 + 64)


def test_limits_are_held_before_anything_is_decoded(seed: Seed) -> None:
    scene = read_container(seed.data).body.scene
    assert scene is not None
    needed = decoding_bytes(scene.count, scene.degree, scene.basis.shape[1])
    with pytest.raises(FormatError, match="max-memory"):
        read_container(seed.data, Limits(max_memory_bytes=needed - 1))
    with pytest.raises(FormatError, match="max-pixels"):
        read_container(seed.data, Limits(max_pixels=scene.count - 1))
    read_container(seed.data, Limits(max_pixels=scene.count, max_memory_bytes=needed))


# ---- octrees ---------------------------------------------------------------------------------------------------------


def _packed(data: bytes) -> bytes:
    return lzma.compress(data, lzma.FORMAT_RAW, filters=octree._FILTERS)


def _raw(stream: bytes) -> bytes:
    return lzma.decompress(stream, lzma.FORMAT_RAW, filters=octree._FILTERS)


def _tree() -> tuple[octree.CodedPoints, int]:
    cells = np.random.default_rng(1).integers(0, 16, (300, 3)).astype(np.float64)
    cells[:270] = cells[0]  # so many in one place that their number does not fit a byte
    cells[270:272] = cells[272]
    return encode_points(np.sort(morton_keys(cells)), 4), 300


def _replaced(number: int, change: Callable[[bytes], bytes]) -> Callable[[octree.CodedPoints], octree.CodedPoints]:
    def attack(points: octree.CodedPoints) -> octree.CodedPoints:
        streams = list(points.streams)
        streams[number] = change(streams[number])
        return replace(points, streams=tuple(streams))

    return attack


def _with_empty_cell(stream: bytes) -> bytes:
    """The last cell's parts in the one before it, which is of the same level."""
    raw = _raw(stream)
    parts = sum(byte.bit_count() for byte in raw[-2:])
    return _packed(raw[:-2] + bytes([0, (1 << parts) - 1]))


def _more_points(further: bytes) -> bytes:
    """One point less in some leaf."""
    at = next(i for i, number in enumerate(further) if 0 < number < octree.ESCAPE)
    return further[:at] + bytes([further[at] - 1]) + further[at + 1 :]


ATTACKS: dict[str, Callable[[octree.CodedPoints], octree.CodedPoints]] = {
    "no LZMA": _replaced(3, lambda _: b"\xff\xff\xff"),
    "no chunk of LZMA2": _replaced(3, lambda _: b"\x03\x00"),
    "nothing": _replaced(3, lambda _: b""),
    "cut": _replaced(3, lambda data: data[:-3]),
    "more behind": _replaced(3, lambda data: data + b"\0"),
    "a bomb": _replaced(3, lambda _: _packed(b"\1" * 50_000_000)),
    "a byte more": _replaced(3, lambda data: _packed(_raw(data) + b"\1")),
    "a byte less": _replaced(3, lambda data: _packed(_raw(data)[:-1])),
    "an empty cell": _replaced(3, lambda data: _packed(b"\0" + _raw(data)[1:])),
    "another part": _replaced(3, lambda data: _packed(bytes([_raw(data)[0] ^ 0xFF or 1]) + _raw(data)[1:])),
    "an empty cell made up for": _replaced(0, _with_empty_cell),
    "a byte in another stream": lambda p: replace(
        p,
        streams=(
            _packed(_raw(p.streams[0]) + b"\1"),
            *p.streams[1:3],
            _packed(_raw(p.streams[3])[:-1]),
            *p.streams[4:],
        ),
    ),
    "more leaves, made up for": lambda p: replace(
        p,
        leaves=p.leaves + 1,
        streams=(*p.streams[:4], _packed(b"\0" + _more_points(_raw(p.streams[4]))), p.streams[5]),
    ),
    "a stream moved": lambda p: replace(p, streams=(p.streams[3], *p.streams[1:3], p.streams[0], *p.streams[4:])),
    "further points": _replaced(4, lambda data: _packed(bytes([3]) + _raw(data)[1:])),
    "escapes for none": _replaced(4, lambda data: _packed(b"\xff" * len(_raw(data)))),
    "a leaf less": _replaced(4, lambda data: _packed(_raw(data)[1:])),
    "another number": _replaced(5, lambda data: _packed(b"\xff\xff\xff\xff")),
    "half a number": _replaced(5, lambda data: _packed(b"\1\0")),
    "other levels": lambda p: replace(p, levels=(*p.levels[:-1], p.levels[-1] + 1)),
    "other leaves": lambda p: replace(p, leaves=p.leaves + 1),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_octrees_that_do_not_come_to_what_is_announced_are_refused(name: str) -> None:
    points, count = _tree()
    assert points.escapes == 1 and len(decode_points(points.streams, points.levels, points.leaves, 1, count)) == count
    tampered = ATTACKS[name](points)
    with pytest.raises(FormatError, match="positions: "):
        decode_points(tampered.streams, tampered.levels, tampered.leaves, tampered.escapes, count)


_PEAK = """
import resource, sys
import tinysplat_runtime as ts
runtime = ts.Runtime(threads=1)
runtime.decompress(open(sys.argv[1], "rb").read())
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
runtime.decompress(open(sys.argv[2], "rb").read())
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
"""


@pytest.mark.parametrize("degree", [0, 2])
def test_decoding_takes_at_most_twice_the_memory_that_the_limit_counts(tmp_path: Path, seed: Seed, degree: int) -> None:
    data = ts.compress(make_free_gaussians(120_000, degree, np.random.default_rng(4)), "fast", 12.0, keep_all=True)
    (tmp_path / "large").write_bytes(data)
    (tmp_path / "small").write_bytes(seed.data)
    command = [sys.executable, "-c", _PEAK, str(tmp_path / "small"), str(tmp_path / "large")]
    grown = int(subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout)
    scene = read_container(data).body.scene
    assert scene is not None
    assert grown <= 2 * decoding_bytes(scene.count, scene.degree, scene.basis.shape[1])


# ---- tiers -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tiers() -> Seed:
    return Seed.of(free_in_tiers(make_free_gaussians(120, 1, np.random.default_rng(3))))


TIER_FIELDS = {
    "count": (0, "<u4", (0, 0xFFFFFFFF)),
    "levels": (4, "u1", (0, 22)),
    "leaves": (8, "<u4", (0, 121, 0xFFFFFFFF)),
    "escapes": (12, "<u4", (121, 0xFFFFFFFF)),
    "cell": (16, "<f8", (np.nan, np.inf, 0, -1, 1.5)),
    "growth": (24, "<f4", (np.nan, np.inf, -0.1, 2.1)),
}


@pytest.mark.parametrize("name", TIER_FIELDS)
def test_no_field_of_a_tier_may_be_what_it_must_not(tiers: Seed, name: str) -> None:
    at, code, values = TIER_FIELDS[name]
    for value in values:
        with pytest.raises(FormatError):
            read_container(changed(tiers, FREE_TIER, field(at, code, value)))


def test_numbers_of_a_tier_that_overflow_together_are_refused(tiers: Seed) -> None:
    """Its records are checked as those of the first tier are: here the offset of the first colour."""
    (levels,) = {len(tier.grid.levels) for tier in read_container(tiers.data).body.scene.tiers[1:2]}
    at = TIER_FIXED.size + 4 * levels + 48
    with pytest.raises(FormatError, match="sh can decode to"):
        read_container(changed(tiers, FREE_TIER, field(at + 8, "<f4", 9e29)))
    with pytest.raises(FormatError, match="1 bytes too many"):
        read_container(changed(tiers, FREE_TIER, lambda data: data.append(0)))


def test_limits_count_the_gaussians_of_all_tiers(tiers: Seed) -> None:
    needed = decoding_bytes(120, 1, ts.inspect(tiers.data)["k"])
    read_container(tiers.data, Limits(max_pixels=120, max_memory_bytes=needed))
    for limits in (Limits(max_pixels=119), Limits(max_memory_bytes=needed - 1)):
        with pytest.raises(FormatError, match="--max-"):
            read_container(tiers.data, limits)


@pytest.mark.parametrize(
    ("kind", "index", "found"),
    [(b"TIER", 3, r"expected TIER\[2\]"), (b"TIER", 0, r"expected TIER\[1\]"), (b"FREP", 3, r"FREP\[2\]: missing"),
     (b"HEVC", 3, r"HEVC\[2\]: missing")],
)  # fmt: skip
def test_tiers_are_numbered_without_gaps(tiers: Seed, kind: bytes, index: int, found: str) -> None:
    sections = [[k, flags, index if (k, i) == (kind, 2) else i, d] for k, flags, i, d in sections_of(tiers.data)]
    with pytest.raises(FormatError, match=found):
        read_container(file_of(sections))


def test_positions_of_no_tier_and_too_many_tiers_are_refused(tiers: Seed) -> None:
    sections = sections_of(tiers.data)
    with pytest.raises(FormatError, match=r"section FREP\[7\] holds positions of no tier"):
        read_container(file_of([*sections, [b"FREP", 1, 7, b""]]))
    second = next(s for s in sections if (s[0], s[2]) == (b"TIER", 2))
    more = [[*second[:2], number, second[3]] for number in range(3, 17)]
    with pytest.raises(FormatError, match="of at most 15"):
        read_container(file_of([*sections, *more]))
