"""Sections LIST and TIER as docs/FORMAT.md has them: their bytes, and every number on either side of its bound.

Files are written by hand here, of constants and of positions that are no octree: their metadata is all that counts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from scenes import refusing
from sections import changed_section, file_of, sections_of

from tinysplat_runtime.container.cameras import rounded_cameras
from tinysplat_runtime.container.list import ListScene, decoding_bytes, list_rows, list_sections, position_streams
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import Limits, Picture
from tinysplat_runtime.container.writer import write_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.planes import PlaneClass as P
from tinysplat_runtime.scene.cameras import Camera

COLORS = [(int(P.COLOR), 0)]
CHANNELS = [(int(P.OPACITY), 0), *((int(P.SCALE), t) for t in range(3)), *((int(P.ROTATION), t) for t in range(3))]
STREAMS = (b"ab", b"", b"c", b"", b"", b"def")
POINTS = struct.pack("<6I", *map(len, STREAMS)) + b"".join(STREAMS)


def floats(values: Sequence[float]) -> bytes:
    return struct.pack(f"<H{len(values)}f", len(values), *values)


@dataclass(frozen=True)
class Tier:
    """A section TIER in numbers, and its rows of the table."""

    count: int = 20
    levels: tuple[int, ...] = (1, 8)
    n_levels: int | None = None
    leaves: int = 20
    escapes: int = 3
    cell: float = 0.5
    growth: float = 0.0
    k: int = 1
    centres: Sequence[float] = ()
    offsets: Sequence[float] = ()
    scales: Sequence[float] = ()
    names: Sequence[tuple[int, int]] = ()
    tail: bytes = b""

    def data(self, set_: int = 0) -> bytes:
        """The section."""
        n_levels = len(self.levels) if self.n_levels is None else self.n_levels
        fixed = struct.pack(
            "<IBBHIIdf", self.count, n_levels, set_, 0, self.leaves, self.escapes, self.cell, self.growth
        )
        centres = self.centres or [0.0] * (7 + self.k)
        return fixed + struct.pack(f"<{len(self.levels)}I{len(centres)}f", *self.levels, *centres) + self.tail

    def rows(self, layer: int) -> list[bytes]:
        """Its channels, all of them numbers, and positions behind."""
        names = self.names or [*((int(P.COLOR), target) for target in range(self.k)), *CHANNELS]
        offsets, scales = self.offsets or [0.5] * len(names), self.scales or [0.0] * len(names)
        rows = [
            struct.pack("<BBBBff", layer, number, target, 255, scale, offset)
            for (number, target), scale, offset in zip(names, scales, offsets, strict=True)
        ]
        return [*rows, struct.pack("<BBBBff", layer, int(P.POSITION), 0, 0, 0, 0)]


@dataclass(frozen=True)
class List:
    """A section LIST in numbers, and tiers."""

    degree: int = 0
    k: int = 1
    centre: tuple[float, ...] = (1.0, 2.0, 3.0)
    radius: float = 4.0
    low: tuple[float, ...] = (-1.0, -2.0, -3.0)
    middle: float = -2.0
    thresholds: tuple[Sequence[float], ...] = ((0.25, 0.5), (), (1.0,))
    orders: tuple[tuple[int, Sequence[float]], ...] = ((0, (1.0, 2.0)), (3, (0.5,)), (1, (1.0,)))
    mean: Sequence[float] = (0.5, -0.25, 1.0)
    basis: Sequence[float] = (1.0, -2.0, 0.5)
    tail: bytes = b""
    tiers: Sequence[Tier] = field(default_factory=lambda: [Tier()])
    stated: int | None = None

    def sections(self) -> list[list]:
        """What the mode adds to a file."""
        data = struct.pack("<BBH7df", self.degree, 0, self.k, *self.centre, self.radius, *self.low, self.middle)
        data += b"".join(map(floats, self.thresholds))
        data += b"".join(struct.pack("<H", first) + floats(gains) for first, gains in self.orders)
        data += np.array(self.mean, "<f4").tobytes() + np.array(self.basis, "<f2").tobytes() + self.tail
        rows = [row for number, tier in enumerate(self.tiers) for row in tier.rows(number)]
        streams = struct.pack("<II", len(POINTS), crc32(POINTS)) * len(self.tiers)
        return [
            [b"LIST", 1, 0, data],
            *([b"TIER", 1, number, tier.data(number)] for number, tier in enumerate(self.tiers)),
            [b"PICT", 1, 0, struct.pack("<HHH", len(rows), 1, 0) + b"".join(rows) + streams],
            [b"DATA", 1, 0, POINTS * len(self.tiers)],
        ]

    def file(self) -> bytes:
        """The file."""
        count = len(self.tiers) if self.stated is None else self.stated
        scene = sections_of(write_container((), np.zeros(3), "max", 0.0, (), (), count, views=1))[0]
        return file_of([scene, *self.sections()])


def read(data: bytes, **limits: int) -> ListScene:
    return read_container(data, Limits(**limits)).body.scene


SECOND = Tier(count=5, leaves=5, escapes=0, levels=(1,), growth=0.25)


def with_tier(**fields: Any) -> bytes:
    return List(tiers=[Tier(), replace(SECOND, **fields)]).file()


def test_what_is_written_by_hand_is_read_and_written_again_to_the_byte() -> None:
    data = with_tier()
    scene = read(data)
    assert (scene.count, scene.degree, scene.size_middle) == (25, 0, -2.0)
    first, second = scene.tiers
    assert (first.count, second.count, first.growth, second.growth) == (20, 5, 0.0, 0.25)
    grid = first.grid
    assert (grid.centre.tolist(), grid.radius, grid.cell, grid.low.tolist()) == ([1, 2, 3], 4, 0.5, [-1, -2, -3])
    assert (grid.levels, grid.leaves, grid.escapes) == ((1, 8), 20, 3)
    assert [values.tolist() for values in scene.thresholds] == [[0.25, 0.5], [], [1.0]]
    assert [(order.first, order.gains) for order in scene.orders] == [(0, (1.0, 2.0)), (3, (0.5,)), (1, (1.0,))]
    assert scene.mean.tolist() == [0.5, -0.25, 1.0] and scene.basis.tolist() == [[1.0], [-2.0], [0.5]]
    assert [c.record.key for c in first.channels] == [*COLORS, *CHANNELS]
    assert first.channel(P.SCALE, 2).record.offset == 0.5
    tiers = tuple(replace(tier, grid=replace(tier.grid, streams=STREAMS)) for tier in scene.tiers)
    again = replace(scene, tiers=tiers)
    rows = sorted(list_rows(again, [{}, {}]), key=lambda row: (row[0], row[1].plane_class))
    assert write_container((), np.zeros(3), "max", 0.0, list_sections(again, [b"", b""]), rows, 2, views=1) == data


def test_positions_are_six_streams_of_the_lengths_in_front_of_them() -> None:
    def streams(data: bytes) -> list[bytes]:
        return list(map(bytes, position_streams(Picture(memoryview(data), len(data), crc32(data), 0))))

    assert streams(POINTS) == list(STREAMS)
    for broken in (b"", POINTS[:23], POINTS[:-1], POINTS + b"\0"):
        with refusing(FormatError, "positions"):
            streams(broken)


def test_cameras_of_a_list_are_those_of_its_photos_as_precise_as_float32() -> None:
    c2w = np.array([[0.6, -0.8, 0, 1.1], [0.8, 0.6, 0, 2.2], [0, 0, 1, 3.3], [0, 0, 0, 1]])
    camera, origin = Camera([[101.7, 0, 12.3], [0, 99.1, 9.9], [0, 0, 1]], c2w, 24, 18), np.array([1e6, 0, 0])
    rounded = rounded_cameras([camera, camera], origin)
    sections = sections_of(List().file())[1:]
    cameras = sections_of(write_container(rounded, origin, "max", 0.0, (), (), 1, views=1))[:2]
    found = read_container(file_of([*cameras, *sections])).body
    assert not found.cameras and len(found.viewpoints) == 2
    for seen in found.viewpoints:
        assert (seen.width, seen.height) == (24, 18)
        np.testing.assert_allclose(seen.c2w, camera.c2w, atol=0.1)  # of a place 1e6 away from the origin
        np.testing.assert_allclose(seen.K, camera.K, rtol=1e-6)


def one(place: int, name: tuple[int, int] | None = None, centre: float = 0.0, scale: float = 0.0, offset: float = 0.5):
    """A tier of whose channels one is other."""
    names, count = [*COLORS, *CHANNELS], 1 + len(CHANNELS)
    names[place] = name or names[place]
    lists = [
        [value if n == place else usual for n in range(count)]
        for value, usual in ((centre, 0.0), (scale, 0.0), (offset, 0.5))
    ]
    return {"tiers": [Tier(names=names, centres=lists[0], scales=lists[1], offsets=lists[2])]}


def of_tier(**fields: Any) -> dict[str, Any]:
    return {"tiers": [Tier(**fields)]}


ONES = {"orders": ((0, [1.0]),) * 3}
OVER = float(np.float32(1.01e30))


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        (of_tier(count=20), of_tier(count=19), "20 leaves and 3 escapes for 19 Gaussians"),
        (of_tier(escapes=20), of_tier(escapes=21), "20 leaves and 21 escapes for 20 Gaussians"),
        ({"degree": 4, "mean": [0] * 75, "basis": [0] * 75}, {"degree": 5}, "SH degree 5, accepted are 0 to 4"),
        ({"k": 0, "basis": (), "tiers": [Tier(k=0)]}, {"k": 4}, "4 0 3"),
        ({}, {"tiers": [Tier(names=CHANNELS)]}, "8 channels of tier 0"),
        ({}, {"tiers": [Tier(names=[*COLORS, *COLORS, *CHANNELS])]}, "10 channels of tier 0"),
        (of_tier(levels=(1,) * 21, leaves=8, cell=1e-6), of_tier(levels=(1,) * 22, leaves=8, cell=1e-6),
         "22 levels, accepted are 1 to 21"),
        (of_tier(levels=(1,), leaves=8), of_tier(n_levels=0), "0 levels, accepted are 1 to 21"),
        (of_tier(levels=(1, 8)), of_tier(levels=(1, 9)), "octree"),
        (of_tier(levels=(1, 3)), of_tier(levels=(1, 2)), "octree"),
        (of_tier(levels=(1, 4, 4)), of_tier(levels=(1, 4, 3)), "octree"),
        ({}, of_tier(levels=(2, 8)), "octree"),
        (of_tier(levels=(1,), leaves=8), of_tier(levels=(1,), leaves=9), "octree"),
        (of_tier(levels=(1, 8), leaves=8), of_tier(levels=(1, 8), leaves=7), "octree"),
        ({"centre": (1e28, -1e28, 0)}, {"centre": (0, 0, math.inf)}, "centre"),
        ({"radius": 1e-9}, {"radius": 0.0}, "radius"),
        ({}, {"radius": 1e30}, "radius 1e+30"),
        (of_tier(cell=1.0), of_tier(cell=1.0001), "cell 1.0001 out of range"),
        (of_tier(cell=1e-9), of_tier(cell=0.0), "cell 0 out of range"),
        ({"radius": 1.0, "low": (-67.0, 0, 0)}, {"radius": 0.5, "low": (0, -67.1, 0)}, "LIST[0]"),
        ({"radius": 0.99e30 / math.exp(5)}, {"radius": 1.01e30 / math.exp(5)}, "LIST[0]"),
        ({"radius": 0.4e30 / math.exp(5), "centre": (0, -0.59e30, 0)},
         {"radius": 0.4e30 / math.exp(5), "centre": (0, -0.61e30, 0)}, "LIST[0]"),
        ({"middle": 69.0}, {"middle": 69.1}, "69.1"),
        ({"middle": -69.0}, {"middle": -69.1}, "LIST[0]"),
        ({}, {"middle": math.nan}, "LIST[0]"),
        ({"thresholds": ((0.5, 0.75), (), ())}, {"thresholds": ((0.5, 0.5), (), ())}, "LIST[0]"),
        ({}, {"thresholds": ((), (), (2.0, 1.0))}, "LIST[0]"),
        ({"thresholds": (range(255), (), ())}, {"thresholds": ((), range(256), ())}, "256 thresholds, at most 255"),
        ({"thresholds": ((), (-9e29,), ())}, {"thresholds": ((), (-OVER,), ())}, "LIST[0]"),
        ({"orders": ((0, [1.0] * 32), (0, [1.0]), (0, [1.0]))}, {"orders": ((0, [1.0]), (0, [1.0] * 33), (0, [1.0]))},
         "33 gains, at most 32"),
        ({}, {"orders": ((0, [1.0]), (0, [1.0]), (0, []))}, "LIST[0]"),
        ({"orders": ((0, [-9e29]), (0, [1.0]), (0, [1.0]))}, {"orders": ((0, [OVER]), (0, [1.0]), (0, [1.0]))},
         "LIST[0]"),
        ({"mean": (9e29, 0, 0)}, {"mean": (0, math.nan, 0)}, "LIST[0]"),
        ({}, {"basis": (math.inf, 0, 0)}, "LIST[0]"),
        ({}, {"mean": (0, 0, -OVER)}, "sh"),
        ({}, one(0, name=(int(P.COLOR), 1)), "PICT[0]"),
        ({}, one(2, name=(int(P.DEPTH), 0)), "depth0 of another mode"),
        (one(1, scale=-9e29), one(1, scale=OVER), "opacity0: scale or offset out of range"),
        (one(1, offset=9e29), one(1, offset=-OVER), "opacity0: scale or offset out of range"),
        (one(1, centre=9e29), one(1, centre=OVER), "centre"),
        ({**ONES, **one(0, offset=-4.9e29)}, {**ONES, **one(0, offset=5.1e29)}, "sh"),
        (one(1, offset=5e29, centre=-4.9e29), one(1, offset=5e29, centre=-5.1e29), "opacities"),
        (one(2, offset=4.9e29), one(2, offset=5.1e29), "scales"),
        (one(4, offset=9e29), {**one(4, offset=9e29), "orders": ((0, [1]), (0, [1.2]), (0, [1]))},
         "scales 2"),
        (one(7, offset=9.9e14), one(7, offset=1.1e15), "rotations"),
        (one(5, centre=-9.9e14), one(6, centre=-1.1e15), "rotations"),
        ({}, {"tail": b"x"}, "1 bytes too many"),
        ({}, {"stated": 0}, "TIER[0]"),
        ({"tiers": [Tier()] * 16}, {"tiers": [Tier()] * 17}, "17 tiers, accepted are 1 to 16"),
        ({}, {"stated": 2}, "TIER[1] missing"),
        ({}, {"tiers": [Tier(), Tier()], "stated": 1}, "TIER[1]"),
    ],
)  # fmt: skip
def test_every_number_is_accepted_to_its_bound_and_no_further(accepted, refused, words: str) -> None:
    assert read(List(**accepted).file()).count % 20 == 0
    with refusing(FormatError, words):
        read(List(**refused).file())


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"growth": 2.0}, {"growth": 2.01}, "growth 2.01, accepted are 0 to 2"),
        ({"growth": 0.0}, {"growth": -0.01}, "growth -0.01"),
        ({"count": 8, "leaves": 8}, {"count": 9, "leaves": 9}, "octree"),
        ({}, {"count": 0, "leaves": 0}, "TIER[1]: 0 Gaussians, accepted are 1 and more"),
        ({"cell": 1.0}, {"cell": 1.1}, "cell 1.1 out of range"),
        ({}, {"tail": b"x"}, "TIER[1]: 1 bytes too many"),
    ],
)
def test_every_number_of_a_tier_is_accepted_to_its_bound_and_no_further(accepted, refused, words: str) -> None:
    assert len(read(with_tier(**accepted)).tiers) == 2
    with refusing(FormatError, words):
        read(with_tier(**refused))


def test_limits_are_the_most_that_is_accepted() -> None:
    data = with_tier()
    memory = decoding_bytes(25, 0, 1)
    assert read(data, max_pixels=25, max_memory_bytes=memory).count == 25
    for limits, words in (
        ({"max_pixels": 24}, "25 24 --max-pixels"),
        ({"max_memory_bytes": memory - 1}, f"{memory} {memory - 1}"),
    ):
        with refusing(FormatError, words):
            read(data, **limits)
    with refusing(FormatError, "0 Gaussians"):
        read(List(tiers=[Tier(count=0, leaves=0, escapes=0)]).file())


def test_parts_by_view_and_several_views_are_of_no_list() -> None:
    for at in (2, 4):

        def change(text: bytearray, at: int = at) -> None:
            text[at] = 3 - at // 2

        with pytest.raises(FormatError):
            read(changed_section(List().file(), b"PICT", change))
