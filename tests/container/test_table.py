"""The table of pictures: docs/FORMAT.md read by hand, and what lies about where pictures are."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from zlib import crc32

import numpy as np
import pytest
from scenes import make_smooth_gaussians, refusing
from sections import Pict, changed_section, file_of, repacked, sections_of
from web.node import Decoder

import tinysplat_runtime as ts
from tinysplat_runtime.container.bounds import decoding_bytes
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.container.planes import MOST_TOGETHER
from tinysplat_runtime.container.reader import read_container, read_outline
from tinysplat_runtime.errors import FormatError, InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS

VIEWS = MOST_TOGETHER + 1


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(VIEWS, 16, 24, degree=1, layers=2)


@pytest.fixture(scope="module")
def data(gaussians):
    return ts.compress(gaussians, profile="fast")


@pytest.mark.parametrize("by_view", [False, True])
def test_pictures_are_where_the_page_says_in_whatever_order(data, by_view):
    """And decode to the same, as the order of bytes is the writer's choice."""
    found = repacked(data, lambda rows: rows[::-1], by_view)
    container, pict, pictures = read_container(found), Pict.of(found), sections_of(found)[-1][3]
    assert pict.by_view == by_view and len(pict.rows) == len(container.table.rows)
    for (layer, record), row in zip(container.table.rows, pict.rows, strict=True):
        assert (layer, record.plane_class, record.target) == row[:3]
        assert bool(record.pictures) == (row[3] != 255)
        assert np.float32([record.scale, record.offset]).tolist() == np.float32(row[4:]).tolist()
    records = {row: record for (_, record), row in zip(container.table.rows, pict.rows, strict=True)}
    for place in pict.places:
        picture = records[place.row].pictures[place.view]
        assert bytes(picture.checked("")) == pictures[place.start : place.start + place.length]
        assert picture.end == len(found) - len(pictures) + place.start + place.length
    whole, again = ts.decompress(data), ts.decompress(found)
    for a, b in zip(whole.layers, again.layers, strict=True):
        assert all(np.array_equal(getattr(a, name), getattr(b, name)) for name in FIELDS)


@pytest.mark.parametrize("views", [[0], [6, 2], [5, 1, 3]])
def test_some_views_are_read_from_their_bytes_alone(data, views):
    """Cameras and quaternions of the file's own; pictures, as a whole file gives them."""
    whole, outline, pictures = read_container(data), read_outline(data), len(sections_of(data)[-1][3])
    parts = {view: data[at : at + length] for view, (at, length) in enumerate(outline.ranges)}
    some = read_container(data[:-pictures], views=views, fetched={view: parts[view] for view in views})
    assert some.table.views == tuple(views)
    for layer, of_whole in zip(some.body.layers, whole.body.layers, strict=True):
        np.testing.assert_array_equal(layer.reference_quats, of_whole.reference_quats[views])
        for at, view in enumerate(views):
            np.testing.assert_array_equal(layer.cameras[at].c2w, of_whole.cameras[view].c2w)
            for a, b in zip(layer.channels, of_whole.channels, strict=True):
                if a.pictures:
                    assert some.table.payload(a, at) == whole.table.payload(b, view)


@pytest.mark.parametrize("views", [[], [0, 0], [VIEWS], [-1], 3, ["a"]])
def test_views_that_there_are_not_are_refused_in_one_line(data, views):
    with refusing(InputError, "views") as caught:
        ts.decompress(data, views=views)
    assert "\n" not in str(caught.value)


def test_limits_count_the_views_that_are_decoded(data):
    layers = read_container(data, views=[2, 3]).body.layers
    pixels, memory = sum(layer.gaussians for layer in layers), sum(map(decoding_bytes, layers))
    assert pixels == 2 * (16 * 24 + layers[1].height * layers[1].width)
    read_container(data, Limits(max_pixels=pixels, max_memory_bytes=memory), views=[2, 3])
    for limits, needed in ((Limits(max_pixels=pixels - 1), pixels), (Limits(max_memory_bytes=memory - 1), memory)):
        with refusing(FormatError, f"{needed} {needed - 1}"):
            read_container(data, limits, views=[2, 3])
    assert ts.inspect(data)["gaussians"] > pixels


def test_the_outline_has_all_cameras_and_where_each_view_is(data, gaussians):
    outline = read_outline(data)
    for found, camera in zip(outline.cameras, gaussians.cameras, strict=True):
        np.testing.assert_array_equal(found.c2w, camera.c2w)
    start = len(data) - len(sections_of(data)[-1][3])
    assert outline.ranges == tuple((start + at, length) for at, length in Pict.of(data).parts)
    assert outline.depth_limits == read_container(data).body.layers[0].depth_limits
    assert read_outline(repacked(data)) is None


def put(at: int, octets: bytes) -> Callable[[bytearray], None]:
    """Writes bytes at a place, from the end where it is negative."""

    def change(text: bytearray) -> None:
        start = at if at >= 0 else len(text) + at
        text[start : start + len(octets)] = octets

    return change


HOSTILE = {
    "a row too many": (b"PICT", lambda text: put(0, bytes([text[0] + 1]))(text)),
    "a view too many": (b"PICT", put(2, bytes([VIEWS + 1]))),
    "an order that there is not": (b"PICT", put(4, b"\2")),
    "all pictures in one part": (b"PICT", put(4, b"\0")),
    "a layer that there is not": (b"PICT", put(6, b"\2")),
    "a class that there is not": (b"PICT", put(7, b"\x09")),
    "a target that there is not": (b"PICT", put(8, b"\x09")),
    "a QP that there is not": (b"PICT", put(9, b"\x34")),
    "a longer part": (
        b"PICT",
        lambda text: put(-8, struct.pack("<I", struct.unpack_from("<I", text, len(text) - 8)[0] + 1))(text),
    ),
    "bytes behind the table": (b"PICT", lambda text: text.append(0)),
    "bytes behind the pictures": (b"DATA", lambda text: text.append(0)),
    "an altered table of a view": (b"DATA", put(0, b"\xff\xff")),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_table_that_lies_is_refused_in_one_line(data, case):
    broken = changed_section(data, *HOSTILE[case])
    with pytest.raises(FormatError) as caught:
        read_container(broken)
    message = str(caught.value)
    assert re.search(r"PICT|DATA|SCEN|LAYR|view \d", message) and "\n" not in message
    with Decoder() as tsplat_js:
        assert tsplat_js(broken)[0]["error"] == "TsplatError"


@pytest.mark.parametrize("length", [0, 10, 2**31])
def test_a_view_whose_table_says_other_lengths_is_refused(data, length):
    """The table's CRC right: a picture that ends before, or behind the view's bytes."""
    pict, start = Pict.of(data), 6 + 12 * len(Pict.of(data).rows)

    def change(text: bytearray) -> None:
        text[:4] = struct.pack("<I", length)

    broken = changed_section(data, b"DATA", change)
    table = sections_of(broken)[-1][3][: pict.table_bytes]
    broken = changed_section(broken, b"PICT", put(start + 4, struct.pack("<I", crc32(table))))
    with refusing(FormatError, "view 0"):
        read_container(broken)


def test_pictures_come_last_and_no_section_stands_twice(data):
    sections = sections_of(data)
    for broken in (sections[::-1], [*sections, sections[0]], sections[:-1], [*sections, sections[-1]]):
        with pytest.raises(FormatError):
            read_container(file_of(broken))
    for kind, flags, index, text in sections:
        with pytest.raises(FormatError):
            read_container(file_of([sections[0], [kind, flags, index, text], *sections[1:]]))
        if kind not in (b"HEVC", b"DATA"):
            with refusing(FormatError, f"{kind.decode()}[7]"):
                read_container(file_of([[kind, flags, 7, text], *sections]))


def test_more_than_4096_views_are_refused_before_anything_is_taken(data):
    for kind, at in ((b"SCEN", 0), (b"PICT", 2)):
        with pytest.raises(FormatError):
            read_container(changed_section(data, kind, put(at, struct.pack("<H", 4097))))
    many = make_smooth_gaussians(1, 1, 1)
    cameras = many.cameras * 4097
    fields = {
        name: np.repeat(getattr(many, name), 4097, axis=0) for name in ("means", "quats", "scales", "opacities", "sh")
    }
    with refusing(InputError, "4097 4096"):
        ts.compress(ts.Gaussians(**fields, cameras=cameras))


def test_a_prefix_gives_the_views_that_it_reaches(data):
    ends = [prefix["bytes"] for prefix in ts.inspect(data)["prefixes"]]
    whole = ts.decompress(data)
    for count, end in enumerate(ends, start=1):
        part = ts.decompress(data[:end], max_bytes=end)
        assert len(part.cameras) == count
        np.testing.assert_array_equal(part.sh, whole.sh[:count])
    begun = ts.decompress(data, max_bytes=ends[1] - 1)  # the last picture of view 1 is cut off
    assert len(begun.cameras) == 2
    np.testing.assert_array_equal(begun.means[0], whole.means[0])
    table = Pict.of(data).table_bytes
    assert len(ts.decompress(data, max_bytes=ends[1] + table - 1).cameras) == 2
    start = ends[0] - Pict.of(data).parts[0][1]
    for length in (table - 1, table):  # of no picture anything
        with pytest.raises(FormatError):
            ts.decompress(data, max_bytes=start + length)


def test_damage_costs_the_view_or_the_picture_that_it_hits_and_both_are_named(data):
    whole = ts.decompress(data)
    ends = [prefix["bytes"] for prefix in ts.inspect(data)["prefixes"]]
    damaged = bytearray(data)
    damaged[ends[1] + 6] ^= 1  # in the table of view 2
    damaged[ends[4] - 1] ^= 1  # in the last picture of view 4
    lost: list[str] = []
    found = ts.decompress(bytes(damaged), lost=lost)
    assert len(lost) == 2 and "2" in lost[0] and "4" in lost[1]
    np.testing.assert_array_equal(found.means[:2], whole.means[:2])
    np.testing.assert_array_equal(found.means[5], whole.means[6])
    with refusing(FormatError, "2"):
        ts.decompress(bytes(damaged))
    with refusing(FormatError, "4"):
        ts.decompress(bytes(damaged), views=[4])
    np.testing.assert_array_equal(ts.decompress(bytes(damaged), views=[3]).means, whole.means[[3]])
