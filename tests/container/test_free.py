"""Sections of mode free as docs/FORMAT.md has them: their bytes, and every number on either side of its bound.

Files are written by hand here, of constants and of positions that are no octree: their metadata is all that counts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from scenes import refusing
from sections import file_of, sections_of

from tinysplat_runtime.container.free import decoding_bytes, free_sections
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import FreeScene, Limits
from tinysplat_runtime.container.writer import write_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.planes import PlaneClass as P

CHANNELS = [(int(P.OPACITY), 0), *((int(P.SCALE), t) for t in range(3)), *((int(P.ROTATION), t) for t in range(3))]
STREAMS = (b"ab", b"", b"c", b"", b"", b"def")


def channel(
    number: int,
    target: int,
    coding: int = 0,
    qp: int = 7,
    scale: float = 0.0,
    offset: float = 0.5,
    centre: float = 0.0,
    tail: bytes = b"",
) -> bytes:
    return struct.pack("<4B2f", number, target, coding, qp, scale, offset) + struct.pack("<f", centre) + tail


def floats(values: Sequence[float]) -> bytes:
    return struct.pack(f"<H{len(values)}f", len(values), *values)


@dataclass(frozen=True)
class Free:
    """A section FREE in numbers, and its FREP."""

    count: int = 20
    degree: int = 0
    levels: tuple[int, ...] = (1, 8)
    n_levels: int | None = None
    n_channels: int | None = None
    k: int = 1
    leaves: int = 20
    escapes: int = 3
    centre: tuple[float, ...] = (1.0, 2.0, 3.0)
    radius: float = 4.0
    cell: float = 0.5
    low: tuple[float, ...] = (-1.0, -2.0, -3.0)
    middle: float = -2.0
    streams: tuple[bytes, ...] = STREAMS
    points: bytes | None = None
    thresholds: tuple[Sequence[float], ...] = ((0.25, 0.5), (), (1.0,))
    orders: tuple[tuple[int, Sequence[float]], ...] = ((0, (1.0, 2.0)), (3, (0.5,)), (1, (1.0,)))
    mean: Sequence[float] = (0.5, -0.25, 1.0)
    basis: Sequence[float] = (1.0, -2.0, 0.5)
    channels: Sequence[bytes] = field(
        default_factory=lambda: [channel(int(P.COLOR), 0), *(channel(*each) for each in CHANNELS)]
    )
    tail: bytes = b""

    def sections(self) -> list[list]:
        n_levels = len(self.levels) if self.n_levels is None else self.n_levels
        n_channels = 7 + self.k if self.n_channels is None else self.n_channels
        data = struct.pack(
            "<IBBHH6sII8df", self.count, self.degree, n_levels, n_channels, self.k, b"", self.leaves, self.escapes,
            *self.centre, self.radius, self.cell, *self.low, self.middle,
        )  # fmt: skip
        data += struct.pack(f"<{len(self.levels)}I", *self.levels)
        data += b"".join(struct.pack("<2I", len(s), crc32(s)) for s in self.streams)
        data += b"".join(map(floats, self.thresholds))
        data += b"".join(struct.pack("<H", first) + floats(gains) for first, gains in self.orders)
        data += np.array(self.mean, "<f4").tobytes() + np.array(self.basis, "<f2").tobytes()
        data += b"".join(self.channels) + self.tail
        return [[b"FREE", 1, 0, data], [b"FREP", 1, 0, b"".join(self.streams) if self.points is None else self.points]]

    def file(self, *more: list) -> bytes:
        (scene,) = sections_of(write_container([], [], np.zeros(3), "max", 0.0))
        return file_of([scene, *self.sections(), *more])


def read(data: bytes, **limits: int) -> FreeScene:
    return read_container(data, Limits(**limits)).body.scene


def tier(
    count: int = 5,
    leaves: int = 5,
    escapes: int = 0,
    cell: float = 0.5,
    growth: float = 0.25,
    levels: Sequence[int] = (1,),
    tail: bytes = b"",
) -> bytes:
    data = struct.pack("<IBBHIIdf", count, len(levels), 0, 0, leaves, escapes, cell, growth)
    data += struct.pack(f"<{len(levels)}I", *levels)
    data += b"".join(struct.pack("<2I", len(s), crc32(s)) for s in STREAMS)
    return data + b"".join(Free().channels) + tail


def with_tier(index: int = 1, **fields: Any) -> bytes:
    return Free().file([b"TIER", 1, index, tier(**fields)], [b"FREP", 1, index, b"".join(STREAMS)])


def test_what_is_written_by_hand_is_read_and_written_again_to_the_byte() -> None:
    scene = read(with_tier())
    assert (scene.count, scene.degree, scene.size_middle) == (25, 0, -2.0)
    first, second = scene.tiers
    assert (first.count, second.count, first.growth, second.growth) == (20, 5, 0.0, 0.25)
    grid = first.grid
    assert (grid.centre.tolist(), grid.radius, grid.cell, grid.low.tolist()) == ([1, 2, 3], 4, 0.5, [-1, -2, -3])
    assert (grid.levels, grid.leaves, grid.escapes) == ((1, 8), 20, 3)
    assert tuple(map(bytes, grid.streams)) == STREAMS == tuple(map(bytes, second.grid.streams))
    assert [values.tolist() for values in scene.thresholds] == [[0.25, 0.5], [], [1.0]]
    assert [(order.first, order.gains) for order in scene.orders] == [(0, (1.0, 2.0)), (3, (0.5,)), (1, (1.0,))]
    assert scene.mean.tolist() == [0.5, -0.25, 1.0] and scene.basis.tolist() == [[1.0], [-2.0], [0.5]]
    assert [(c.record.plane_class, c.record.target) for c in first.channels] == [(P.COLOR, 0), *CHANNELS]
    assert first.channel(P.SCALE, 2).record.offset == 0.5 and first.channel(P.SCALE, 2).record.qp == 7
    written = [[s.kind, 1, s.index, s.data] for s in free_sections(scene, [{}, {}], [b"", b""])]
    assert written == [
        Free().sections()[0],
        [b"TIER", 1, 1, tier()],
        Free().sections()[1],
        [b"FREP", 1, 1, b"".join(STREAMS)],
    ]
    assert write_container([], [], np.zeros(3), "max", 0.0, free_sections(scene, [{}, {}], [b"", b""]))[10] == 6


def one(place: int, **fields: Any) -> dict[str, Any]:
    """All channels, one of them other."""
    places = [(int(P.COLOR), 0), *CHANNELS]
    number, target = fields.pop("name", places[place])
    return {
        "channels": [
            channel(*each) if n != place else channel(number, target, **fields) for n, each in enumerate(places)
        ]
    }


ONES = {"orders": ((0, [1.0]),) * 3}
OVER = float(np.float32(1.01e30))


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"count": 20}, {"count": 19}, "20 leaves and 3 escapes for 19 Gaussians"),
        ({"escapes": 20}, {"escapes": 21}, "20 leaves and 21 escapes for 20 Gaussians"),
        ({"degree": 4, "mean": [0] * 75, "basis": [0] * 75}, {"degree": 5}, "SH degree 5, accepted are 0 to 4"),
        ({"k": 0, "basis": (), "channels": [channel(*each) for each in CHANNELS]}, {"k": 4}, "4 0 3"),
        ({}, {"n_channels": 7}, "7 channels, expected 8"),
        ({}, {"n_channels": 9}, "9 channels, expected 8"),
        ({"levels": (1,) * 21, "leaves": 8, "cell": 1e-6}, {"levels": (1,) * 22, "leaves": 8, "cell": 1e-6},
         "22 levels, accepted are 1 to 21"),
        ({"levels": (1,), "leaves": 8}, {"n_levels": 0}, "0 levels, accepted are 1 to 21"),
        ({"levels": (1, 8)}, {"levels": (1, 9)}, "octree"),
        ({"levels": (1, 3)}, {"levels": (1, 2)}, "octree"),
        ({"levels": (1, 4, 4)}, {"levels": (1, 4, 3)}, "octree"),
        ({}, {"levels": (2, 8)}, "octree"),
        ({"levels": (1,), "leaves": 8}, {"levels": (1,), "leaves": 9}, "octree"),
        ({"levels": (1, 8), "leaves": 8}, {"levels": (1, 8), "leaves": 7}, "octree"),
        ({}, {"points": b"abcdeg"}, "stream 5 of the positions was altered"),
        ({}, {"points": b"xbcdef"}, "stream 0 of the positions was altered"),
        ({}, {"points": b"abcdefg"}, "7 bytes of positions, 6 announced"),
        ({"centre": (1e28, -1e28, 0)}, {"centre": (0, 0, math.inf)}, "centre"),
        ({"radius": 1e-9}, {"radius": 0.0}, "radius"),
        ({}, {"radius": 1e30}, "radius 1e+30"),
        ({"cell": 1.0}, {"cell": 1.0001}, "cell 1.0001 out of range"),
        ({"cell": 1e-9}, {"cell": 0.0}, "cell 0 out of range"),
        ({"radius": 1.0, "low": (-67.0, 0, 0)}, {"radius": 0.5, "low": (0, -67.1, 0)}, "FREE[0]"),
        ({"radius": 0.99e30 / math.exp(5)}, {"radius": 1.01e30 / math.exp(5)}, "FREE[0]"),
        ({"radius": 0.4e30 / math.exp(5), "centre": (0, -0.59e30, 0)},
         {"radius": 0.4e30 / math.exp(5), "centre": (0, -0.61e30, 0)}, "FREE[0]"),
        ({"middle": 69.0}, {"middle": 69.1}, "69.1"),
        ({"middle": -69.0}, {"middle": -69.1}, "FREE[0]"),
        ({}, {"middle": math.nan}, "FREE[0]"),
        ({"thresholds": ((0.5, 0.75), (), ())}, {"thresholds": ((0.5, 0.5), (), ())}, "FREE[0]"),
        ({}, {"thresholds": ((), (), (2.0, 1.0))}, "FREE[0]"),
        ({"thresholds": (range(255), (), ())}, {"thresholds": ((), range(256), ())}, "256 thresholds, at most 255"),
        ({"thresholds": ((), (-9e29,), ())}, {"thresholds": ((), (-OVER,), ())}, "FREE[0]"),
        ({"orders": ((0, [1.0] * 32), (0, [1.0]), (0, [1.0]))}, {"orders": ((0, [1.0]), (0, [1.0] * 33), (0, [1.0]))},
         "33 gains, at most 32"),
        ({}, {"orders": ((0, [1.0]), (0, [1.0]), (0, []))}, "FREE[0]"),
        ({"orders": ((0, [-9e29]), (0, [1.0]), (0, [1.0]))}, {"orders": ((0, [OVER]), (0, [1.0]), (0, [1.0]))},
         "FREE[0]"),
        ({"mean": (9e29, 0, 0)}, {"mean": (0, math.nan, 0)}, "FREE[0]"),
        ({}, {"basis": (math.inf, 0, 0)}, "FREE[0]"),
        ({}, {"mean": (0, 0, -OVER)}, "sh"),
        ({}, one(0, name=(int(P.COLOR), 1)), "class 1, channel 1; expected color0"),
        ({}, one(2, name=(int(P.ROTATION), 0)), "expected scale0"),
        ({}, one(3, coding=2), "coding 2 is unknown"),
        (one(3, qp=51), one(3, qp=52), "QP 52, accepted are 0 to 51"),
        (one(1, scale=-9e29), one(1, scale=OVER), "opacity0: scale, offset or centre out of range"),
        (one(1, offset=9e29), one(1, offset=-OVER), "opacity0: scale, offset or centre out of range"),
        (one(1, centre=9e29), one(1, centre=OVER), "opacity0: scale, offset or centre out of range"),
        ({**ONES, **one(0, offset=-4.9e29)}, {**ONES, **one(0, offset=5.1e29)}, "sh"),
        (one(1, offset=5e29, centre=-4.9e29), one(1, offset=5e29, centre=-5.1e29), "opacities"),
        (one(2, offset=4.9e29), one(2, offset=5.1e29), "scales"),
        (one(4, offset=9e29), {**one(4, offset=9e29), "orders": ((0, [1]), (0, [1.2]), (0, [1]))},
         "scales 2"),
        (one(7, offset=9.9e14), one(7, offset=1.1e15), "rotations"),
        (one(5, centre=-9.9e14), one(6, centre=-1.1e15), "rotations"),
        ({}, {"tail": b"x"}, "1 bytes too many"),
    ],
)  # fmt: skip
def test_every_number_is_accepted_to_its_bound_and_no_further(accepted, refused, words: str) -> None:
    assert read(Free(**accepted).file()).count == 20
    with refusing(FormatError, words):
        read(Free(**refused).file())


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"growth": 2.0}, {"growth": 2.01}, "growth 2.01, accepted are 0 to 2"),
        ({"growth": 0.0}, {"growth": -0.01}, "growth -0.01"),
        ({"count": 8, "leaves": 8}, {"count": 9, "leaves": 9}, "octree"),
        ({}, {"count": 0, "leaves": 0}, r"TIER\[1\]: 0 Gaussians, accepted are 1 and more"),
        ({"cell": 1.0}, {"cell": 1.1}, "cell 1.1 out of range"),
        ({}, {"index": 2}, r"TIER\[2\]: expected TIER\[1\], of at most 15"),
        ({}, {"tail": b"x"}, r"TIER\[1\]: 1 bytes too many"),
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
    with refusing(FormatError, "0 1"):
        read(Free(count=0, leaves=0, escapes=0).file())
