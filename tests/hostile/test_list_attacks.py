"""Attacks on files of mode list, one by one: what fuzzing finds by chance, and what it never would."""

import lzma
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hostile.containers import Seed, changed, field, memory_of_decoding
from scenes import list_in_tiers, make_list, refusing
from sections import file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.list import TIER, decoding_bytes
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.curve import morton_keys
from tinysplat_runtime.list.coding import octree
from tinysplat_runtime.list.coding.octree import decode_points, encode_points


@pytest.fixture(scope="module")
def seed() -> Seed:
    return Seed.of(ts.compress(make_list(400, 1, np.random.default_rng(3)), qp=-12.0, keep_all=True))


@pytest.mark.parametrize(("count", "is_paid"), [(1, True), (256, True), (257, False), (9000, False)])
def test_a_byte_of_a_file_stands_for_256_gaussians_at_most(count: int, is_paid: bool, seed: Seed) -> None:
    """Equal Gaussians in one place take next to no bytes, but memory as any others do."""
    at = sum(len(part.data) for part in seed.parts)
    data = changed(seed, TIER, field(0, "<u4", count * at))
    if is_paid:
        read_container(data)  # which does not count the points
    else:
        with refusing(FormatError, str(256 * at)):
            read_container(data)
    with pytest.raises(FormatError):
        ts.decompress(data)


# ---- octrees ---------------------------------------------------------------------------------------------------------


LZMA = [{"id": lzma.FILTER_LZMA2, "lc": 0, "lp": 0, "pb": 0, "dict_size": 1 << 16}]


def _packed(data: bytes) -> bytes:
    return lzma.compress(data, lzma.FORMAT_RAW, filters=LZMA)


def _raw(stream: bytes) -> bytes:
    return lzma.decompress(stream, lzma.FORMAT_RAW, filters=LZMA)


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
    "cut": _replaced(3, lambda data: data[:-3]),
    "more behind": _replaced(3, lambda data: data + b"\0"),
    "a bomb": _replaced(3, lambda _: _packed(b"\1" * 50_000_000)),
    "a byte more": _replaced(3, lambda data: _packed(_raw(data) + b"\1")),
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
    "another number": _replaced(5, lambda data: _packed(b"\xff\xff\xff\xff")),
    "other levels": lambda p: replace(p, levels=(*p.levels[:-1], p.levels[-1] + 1)),
    "other leaves": lambda p: replace(p, leaves=p.leaves + 1),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_octrees_that_do_not_come_to_what_is_announced_are_refused(name: str) -> None:
    points, count = _tree()
    assert points.escapes == 1 and len(decode_points(points.streams, points.levels, points.leaves, 1, count)) == count
    tampered = ATTACKS[name](points)
    with pytest.raises(FormatError):
        decode_points(tampered.streams, tampered.levels, tampered.leaves, tampered.escapes, count)


@pytest.mark.parametrize("degree", [0, 2])
def test_decoding_takes_at_most_twice_the_memory_that_the_limit_counts(tmp_path: Path, seed: Seed, degree: int) -> None:
    data = ts.compress(make_list(120_000, degree, np.random.default_rng(4)), "fast", 12.0, keep_all=True)
    grown = memory_of_decoding(tmp_path, seed.data, data)
    scene = read_container(data).body.scene
    assert scene is not None
    assert grown <= 2 * decoding_bytes(scene.count, scene.degree, scene.basis.shape[1])


# ---- tiers -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tiers() -> Seed:
    return Seed.of(list_in_tiers(make_list(120, 1, np.random.default_rng(3))))


def test_a_tier_needs_its_parameter_sets_and_its_rows(tiers: Seed) -> None:
    without = [s for s in sections_of(tiers.data) if (s[0], s[2]) != (b"HEVC", 2)]
    with refusing(FormatError, "TIER[2] 2"):
        read_container(file_of(without))
    positions = next(n for n, row in enumerate(tiers.pict.rows) if row[:2] == (1, 6))
    for at, value in ((0, 2), (1, 1), (2, 1), (3, 255)):  # of another tier, another class, another target, a constant
        with pytest.raises(FormatError):
            read_container(changed(tiers, L.PICTURES, field(6 + 12 * positions + at, "u1", value)))
