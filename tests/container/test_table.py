"""The table of pictures: docs/FORMAT.md read by hand, and what lies about where pictures are."""

import re
import struct
from collections.abc import Callable

import numpy as np
import pytest
from scenes import make_smooth_gaussians, refusing
from sections import Pict, changed_section, file_of, repacked, sections_of
from web.node import Decoder

import tinysplat_runtime as ts
from tinysplat_runtime.container.bounds import decoding_bytes
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS

VIEWS = 7


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(VIEWS, 16, 24, degree=1, layers=2)


@pytest.fixture(scope="module")
def data(gaussians):
    return ts.compress(gaussians, profile="fast")


def test_pictures_are_where_the_page_says_in_whatever_order(data):
    """And decode to the same, as the order of bytes is the writer's choice."""
    found = repacked(data, lambda rows: rows[::-1])
    container, pict, pictures = read_container(found), Pict.of(found), sections_of(found)[-1][3]
    assert len(pict.rows) == len(container.table.rows)
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
def test_some_views_are_read_as_they_are_in_the_whole_file(data, views):
    whole, some = read_container(data), read_container(data, views=views)
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


def put(at: int, octets: bytes) -> Callable[[bytearray], None]:
    """Writes bytes at a place, from the end where it is negative."""

    def change(text: bytearray) -> None:
        start = at if at >= 0 else len(text) + at
        text[start : start + len(octets)] = octets

    return change


HOSTILE = {
    "a row too many": (b"PICT", lambda text: put(0, bytes([text[0] + 1]))(text)),
    "a view too many": (b"PICT", put(2, bytes([VIEWS + 1]))),
    "an order that there is not": (b"PICT", put(4, b"\1")),
    "a layer that there is not": (b"PICT", put(6, b"\2")),
    "a class that there is not": (b"PICT", put(7, b"\x09")),
    "a target that there is not": (b"PICT", put(8, b"\x09")),
    "a QP that there is not": (b"PICT", put(9, b"\x34")),
    "a longer picture": (
        b"PICT",
        lambda text: put(-8, struct.pack("<I", struct.unpack_from("<I", text, len(text) - 8)[0] + 1))(text),
    ),
    "bytes behind the table": (b"PICT", lambda text: text.append(0)),
    "bytes behind the pictures": (b"DATA", lambda text: text.append(0)),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_table_that_lies_is_refused_in_one_line(data, case):
    broken = changed_section(data, *HOSTILE[case])
    with pytest.raises(FormatError) as caught:
        read_container(broken)
    message = str(caught.value)
    assert re.search(r"PICT|DATA|SCEN|LAYR", message) and "\n" not in message
    with Decoder() as tsplat_js:
        assert tsplat_js(broken)[0]["error"] == "TsplatError"


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
