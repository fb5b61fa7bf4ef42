"""Sections LIST and TIER: their bytes as docs/FORMAT.md has them, and every number on either side of its bound.

Files here are of constants and of positions that are no octree: their metadata are all that counts.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from scenes import refusing
from sections import file_of, sections_of

from tinysplat_runtime.container.cameras import rounded_cameras
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.container.list import (
    ListChannel,
    ListScene,
    PointGrid,
    Tier,
    WeightClasses,
    decoding_bytes,
    list_rows,
    list_sections,
    position_streams,
)
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import ChannelRecord, Picture
from tinysplat_runtime.container.sections import packed_columns
from tinysplat_runtime.container.writer import Head, write_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.planes import PlaneClass as P
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.viewpoints import Viewpoint

NAMES = [(P.COLOR, 0), (P.OPACITY, 0), *((P.SCALE, t) for t in range(3)), *((P.ROTATION, t) for t in range(3))]
STREAMS = (b"ab", b"", b"c", b"", b"", b"def")
POINTS = struct.pack("<6I", *map(len, STREAMS)) + b"".join(STREAMS)


def channels(names: Sequence[tuple[P, int]]) -> tuple[ListChannel, ...]:
    return tuple(ListChannel(ChannelRecord(*name, 255, 0.0, 0.5), 0.0) for name in names)


GRID = PointGrid(np.array([1.0, 2, 3]), 4.0, 0.5, np.array([-1.0, -2, -3]), (1, 8), 20, 3, STREAMS)
TIER = Tier(20, GRID, channels(NAMES))
ORDERS = WeightClasses(0, (1.0, 2.0)), WeightClasses(3, (0.5,)), WeightClasses(1, (1.0,))
THRESHOLDS = tuple(np.array(values, np.float32) for values in ((0.25, 0.5), (), (1.0,)))
BASIS = np.array([[1.0], [-2.0], [0.5]], np.float16)
SCENE = ListScene(0, -2.0, THRESHOLDS, ORDERS, np.float32([0.5, -0.25, 1.0]), BASIS, (TIER,))
ARRAYS = {"mean": np.float32, "basis": np.float16, "centre": np.float64, "low": np.float64}


def scene_of(**values: Any) -> ListScene:
    """The scene with other numbers: of its own, or of all its tiers and their grids."""
    values |= {name: np.array(values[name], kind) for name, kind in ARRAYS.items() if name in values}
    own, tier, grid = (
        {name: value for name, value in values.items() if name in {field.name for field in fields(kind)}}
        for kind in (ListScene, Tier, PointGrid)
    )
    tiers = own.pop("tiers", SCENE.tiers)
    changed = tuple(replace(each, grid=replace(each.grid, **grid), **tier) for each in tiers)
    return replace(SCENE, tiers=changed, **own)


def file(stated: int | None = None, tail: tuple[bytes, bytes] = (b"", b""), **values: Any) -> bytes:
    """A file of `scene_of`; it says that it has so many tiers, and a section has bytes behind it."""
    scene = scene_of(**values)
    count = len(scene.tiers)
    rows, sections = list(list_rows(scene, [{}] * count)), list_sections(scene, [b""] * count)
    sections = [replace(section, data=section.data + tail[1] * (section.kind == tail[0])) for section in sections]
    head, tiers = Head((), np.zeros(3), "max", 0.0), count if stated is None else stated
    return write_container(head, sections, rows, tiers, views=1)


def read(data: bytes, **limits: int) -> ListScene:
    return read_container(data, Limits(**limits)).body.scene


def test_a_list_is_laid_out_as_the_page_says_and_comes_back() -> None:
    second = replace(TIER, count=5, grid=replace(GRID, levels=(1,), leaves=5, escapes=0), parameter_set=1, growth=0.25)
    data = file(tiers=(TIER, second))
    texts = {(kind, index): text for kind, _, index, text in sections_of(data)}
    by_hand = struct.pack("<BBH7df", 0, 0, 1, 1, 2, 3, 4, -1, -2, -3, -2)
    by_hand += struct.pack("<H2f H H1f", 2, 0.25, 0.5, 0, 1, 1)
    by_hand += struct.pack("<HH2f HHf HHf", 0, 2, 1, 2, 3, 1, 0.5, 1, 1, 1)
    assert texts[b"LIST", 0] == by_hand + struct.pack("<3f3e", 0.5, -0.25, 1, 1, -2, 0.5)
    assert texts[b"TIER", 0] == struct.pack("<IBBHIIdf", 20, 2, 0, 0, 20, 3, 0.5, 0) + struct.pack(
        "<2I8f", 1, 8, *[0] * 8
    )
    assert texts[b"TIER", 1] == struct.pack("<IBBHIIdf", 5, 1, 1, 0, 5, 0, 0.5, 0.25) + struct.pack("<I8f", 1, *[0] * 8)
    assert texts[b"DATA", 0] == 2 * POINTS
    scene = read(data)
    grids = [replace(tier.grid, streams=STREAMS) for tier in scene.tiers]
    tiers = tuple(replace(tier, grid=grid, positions=None) for tier, grid in zip(scene.tiers, grids, strict=True))
    assert scene.count == 25 and file(**{**vars(scene), "tiers": tiers}) == data


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
    sections = sections_of(file())[1:]
    cameras = sections_of(write_container(Head(rounded, origin, "max", 0.0), (), (), 1, views=1))[:2]
    found = read_container(file_of([*cameras, *sections])).body
    assert not found.cameras and len(found.viewpoints) == 2
    for seen in found.viewpoints:
        assert (seen.width, seen.height) == (24, 18)
        np.testing.assert_allclose(seen.c2w, camera.c2w, atol=0.1)  # of a place 1e6 away from the origin
        np.testing.assert_allclose(seen.K, camera.K, rtol=1e-6)


def test_steps_of_cameras_are_kept_and_those_that_are_none_are_refused() -> None:
    K, turn, shift = (
        [[101.7, 0, 12.3], [0, 99.1, 9.9], [0, 0, 1]],
        np.array([1e-3, -2e-3, 0]),
        np.array([0, 1e-2, 3e-2]),
    )
    gain = np.array([0.5, 1.5, 2])
    given = [Viewpoint(K, np.eye(4), 24, 18, turn, shift, True, gain), Camera(K, np.eye(4), 24, 18)]
    rounded = rounded_cameras(given, np.zeros(3))
    written = sections_of(write_container(Head(rounded, np.zeros(3), "max", 0.0), (), (), 1, views=1))[:3]
    rest = sections_of(file())[1:]
    first, second = read_container(file_of([*written, *rest])).body.viewpoints
    np.testing.assert_allclose([first.turn, first.shift, first.gain], [turn, shift, gain], rtol=1e-6)
    assert first.is_alone and not second.is_alone and not second.turn.any() and not second.shift.any()
    assert (second.gain == 1).all()
    columns = np.array([[*turn, *shift, 1, *gain], [0] * 7 + [1] * 3])
    for place, wrong in ((0, np.nan), (1, 9.0), (4, np.inf), (5, 1e16), (6, 0.5), (7, 0), (8, 2000), (9, np.nan)):
        columns[1] = [0] * 7 + [1] * 3
        columns[1, place] = wrong
        with refusing(FormatError, "STEP view 1"):
            read_container(file_of([*written[:2], [b"STEP", 0, 0, packed_columns(columns)], *rest]))
    for data in (packed_columns(columns[:, :5]), packed_columns(columns) + b"\0"):
        with refusing(FormatError, "STEP"):
            read_container(file_of([*written[:2], [b"STEP", 0, 0, data], *rest]))


def one(place: int, **values: Any) -> dict[str, Any]:
    """All channels, one of them other."""
    of_record = {name: value for name, value in values.items() if name != "centre"}
    found = list(TIER.channels)
    record = replace(found[place].record, **of_record)
    found[place] = replace(found[place], record=record, centre=values.get("centre", 0.0))
    return {"channels": tuple(found)}


def lists(*values: Sequence[float]) -> dict[str, Any]:
    return {"thresholds": tuple(np.array(each, np.float32) for each in values)}


def gains(*values: Sequence[float]) -> dict[str, Any]:
    return {"orders": tuple(WeightClasses(0, tuple(each)) for each in values)}


ONES = gains([1.0], [1.0], [1.0])
OVER = float(np.float32(1.01e30))


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"count": 20}, {"count": 19}, "20 leaves and 3 escapes for 19 Gaussians"),
        ({"escapes": 20}, {"escapes": 21}, "20 leaves and 21 escapes for 20 Gaussians"),
        ({"degree": 4, "mean": [0] * 75, "basis": [[0]] * 75}, {"degree": 5}, "SH degree 5, accepted are 0 to 4"),
        ({"basis": np.zeros((3, 0)), "channels": channels(NAMES[1:])}, {"basis": np.zeros((3, 4))}, "4 0 3"),
        ({}, {"basis": np.zeros((3, 0)), "channels": channels(NAMES)}, "TIER[0]"),
        ({}, {"basis": np.zeros((3, 2)), "channels": channels([NAMES[0], *NAMES])}, "10 channels of tier 0"),
        ({"levels": (1,) * 21, "leaves": 8, "cell": 1e-6}, {"levels": (1,) * 22, "leaves": 8, "cell": 1e-6},
         "22 levels, accepted are 1 to 21"),
        ({"levels": (1,), "leaves": 8}, {"levels": (), "leaves": 8}, "0 levels, accepted are 1 to 21"),
        ({"levels": (1, 8)}, {"levels": (1, 9)}, "octree"),
        ({}, {"levels": (2, 8)}, "octree"),
        ({"levels": (1, 8), "leaves": 8}, {"levels": (1, 8), "leaves": 7}, "octree"),
        ({"centre": (1e28, -1e28, 0)}, {"centre": (0, 0, math.inf)}, "centre"),
        ({"radius": 1e-9}, {"radius": 0.0}, "radius"),
        ({}, {"radius": 1e30}, "radius 1e+30"),
        ({"cell": 1.0}, {"cell": 1.0001}, "cell 1.0001 out of range"),
        ({"radius": 1.0, "low": (-67.0, 0, 0)}, {"radius": 0.5, "low": (0, -67.1, 0)}, "LIST[0]"),
        ({"radius": 0.99e30 / math.exp(5)}, {"radius": 1.01e30 / math.exp(5)}, "LIST[0]"),
        ({"radius": 0.4e30 / math.exp(5), "centre": (0, -0.59e30, 0)},
         {"radius": 0.4e30 / math.exp(5), "centre": (0, -0.61e30, 0)}, "LIST[0]"),
        ({"size_middle": 69.0}, {"size_middle": 69.1}, "69.1"),
        (lists((0.5, 0.75), (), ()), lists((0.5, 0.5), (), ()), "LIST[0]"),
        (lists(range(255), (), ()), lists((), range(256), ()), "256 thresholds, at most 255"),
        (lists((), (-9e29,), ()), lists((), (-OVER,), ()), "LIST[0]"),
        (gains([1.0] * 32, [1.0], [1.0]), gains([1.0], [1.0] * 33, [1.0]),
         "33 gains, at most 32"),
        ({}, gains([1.0], [1.0], []), "LIST[0]"),
        (gains([-9e29], [1.0], [1.0]), gains([OVER], [1.0], [1.0]),
         "LIST[0]"),
        ({"mean": (9e29, 0, 0)}, {"mean": (0, math.nan, 0)}, "LIST[0]"),
        ({}, {"basis": [[math.inf], [0], [0]]}, "LIST[0]"),
        ({}, {"mean": (0, 0, -OVER)}, "sh"),
        ({}, one(0, target=1), "PICT[0]"),
        (one(1, scale=-9e29), one(1, scale=OVER), "opacity0: scale or offset out of range"),
        (one(1, centre=9e29), one(1, centre=OVER), "centre"),
        ({**ONES, **one(0, offset=-4.9e29)}, {**ONES, **one(0, offset=5.1e29)}, "sh"),
        (one(1, offset=5e29, centre=-4.9e29), one(1, offset=5e29, centre=-5.1e29), "opacities"),
        (one(2, offset=4.9e29), one(2, offset=5.1e29), "scales"),
        (one(4, offset=9e29), {**one(4, offset=9e29), **gains([1], [1.2], [1])},
         "scales 2"),
        (one(7, offset=9.9e14), one(7, offset=1.1e15), "rotations"),
        ({}, {"tail": (b"LIST", b"x")}, "1 bytes too many"),
        ({"growth": 2.0}, {"growth": 2.01}, "growth 2.01, accepted are 0 to 2"),
        ({}, {"count": 0, "leaves": 0, "escapes": 0}, "0 Gaussians, accepted are 1 and more"),
        ({"tiers": [TIER] * 16}, {"tiers": [TIER] * 17}, "17 tiers, accepted are 1 to 16"),
        ({}, {"stated": 2}, "TIER[1] missing"),
        ({}, {"tiers": [TIER, TIER], "stated": 1}, "TIER[1]"),
    ],
)  # fmt: skip
def test_every_number_is_accepted_to_its_bound_and_no_further(accepted, refused, words: str) -> None:
    assert read(file(**accepted)).count % 20 == 0
    with refusing(FormatError, words):
        read(file(**refused))


def test_limits_are_the_most_that_is_accepted() -> None:
    data = file(tiers=(TIER, TIER))
    memory = decoding_bytes(40, 0, 1)
    assert read(data, max_pixels=40, max_memory_bytes=memory, max_layers=2).count == 40
    for limits, words in (
        ({"max_pixels": 39}, "40 39 --max-pixels"),
        ({"max_memory_bytes": memory - 1}, f"{memory} {memory - 1}"),
        ({"max_layers": 1}, "2 1"),
    ):
        with refusing(FormatError, words):
            read(data, **limits)
