"""Views as units: docs/FORMAT.md read by hand, and what lies about where views are."""

from __future__ import annotations

import re
import struct
from zlib import crc32

import numpy as np
import pytest
from scenes import make_smooth_gaussians, refusing
from sections import file_of, sections_of
from web.node import Decoder

import tinysplat_runtime as ts
from tinysplat_runtime.container.bounds import decoding_bytes
from tinysplat_runtime.container.reader import read_container, read_outline
from tinysplat_runtime.container.records import Limits
from tinysplat_runtime.container.units import MOST_TOGETHER
from tinysplat_runtime.errors import FormatError, InputError

VIEWS = MOST_TOGETHER + 1


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(VIEWS, 16, 24, degree=1, layers=2)


@pytest.fixture(scope="module")
def data(gaussians):
    return ts.compress(gaussians, profile="fast")


def _changed(data: bytes, kind: bytes, change, index: int = 0) -> bytes:
    sections = sections_of(data)
    for section in sections:
        if section[0] == kind and section[2] == index:
            section[3] = change(section[3])
    return file_of(sections)


def test_files_of_more_views_than_a_network_takes_have_a_section_for_each(data, gaussians):
    kinds = [(kind, index) for kind, _, index, _ in sections_of(data)]
    assert kinds[-VIEWS:] == [(b"VIEW", view) for view in range(VIEWS)] and (b"UNIT", 0) in kinds
    assert ts.inspect(data)["version"] == "1.5"
    few = ts.compress(make_smooth_gaussians(MOST_TOGETHER, 16, 24, degree=1), profile="fast")
    assert ts.inspect(few)["version"] == "1.0" and not {kind for kind, *_ in sections_of(few)} & {b"UNIT", b"VIEW"}


def test_a_view_has_what_the_page_says_where_the_page_says(data):
    """Head by hand: a layer's intrinsics and reference quaternion by its flags, then UNIT's lengths and CRCs."""
    sections = {(kind, index): section for kind, _, index, section in sections_of(data)}
    count, _ = struct.unpack_from("<HH", sections[b"UNIT", 0])
    order = [struct.unpack_from("<BB", sections[b"UNIT", 0], 4 + 2 * n) for n in range(count)]
    assert len(sections[b"UNIT", 0]) == 4 + 2 * count and len(set(order)) == count
    container = read_container(data)
    coded = {(n, i) for n, layer in enumerate(container.body.layers) for i, c in enumerate(layer.channels) if c.streams}
    assert set(order) == coded
    for view in (0, 3, VIEWS - 1):
        unit = sections[b"VIEW", view]
        at, layers = 4, container.body.layers
        for n, layer in enumerate(layers):
            if sections[b"LAYR", n][10] & 16:
                fx, fy, cx, cy, skew = struct.unpack_from("<5d", unit, at)
                np.testing.assert_array_equal(layer.cameras[view].K, [[fx, skew, cx], [0, fy, cy], [0, 0, 1]])
                at += 40
            if sections[b"LAYR", n][10] & 2:
                np.testing.assert_array_equal(struct.unpack_from("<4f", unit, at), layer.reference_quats[view])
                at += 16
        rows, at = at, at + 8 * count
        assert struct.unpack_from("<I", unit)[0] == crc32(unit[4:at])
        for n, (layer, record) in enumerate(order):
            length, crc = struct.unpack_from("<II", unit, rows + 8 * n)
            picture = container.pictures.payload(layer, layers[layer].channels[record], view)
            assert bytes(picture) == unit[at : at + length] and crc32(picture) == crc
            at += length
        assert at == len(unit)


@pytest.mark.parametrize("views", [[0], [6, 2], [5, 1, 3]])
def test_some_views_are_read_from_their_bytes_alone(data, views):
    """Cameras and quaternions of the file's own; pictures, as a whole file gives them."""
    whole, sections = read_container(data), sections_of(data)
    units = {index: section for kind, _, index, section in sections if kind == b"VIEW"}
    metadata = data[: len(data) - sum(map(len, units.values()))]
    some = read_container(metadata, views=views, units={view: units[view] for view in views})
    assert some.views == tuple(views)
    for n, (layer, of_whole) in enumerate(zip(some.body.layers, whole.body.layers, strict=True)):
        np.testing.assert_array_equal(layer.reference_quats, of_whole.reference_quats[views])
        for at, view in enumerate(views):
            np.testing.assert_array_equal(layer.cameras[at].c2w, of_whole.cameras[view].c2w)
            for a, b in zip(layer.channels, of_whole.channels, strict=True):
                if a.streams:
                    assert some.pictures.payload(n, a, at) == whole.pictures.payload(n, b, view)


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
    units = {index: section for kind, _, index, section in sections_of(data) if kind == b"VIEW"}
    assert [data[at : at + length] for at, length in outline.ranges] == [units[view] for view in range(VIEWS)]
    assert outline.depth_limits == read_container(data).body.layers[0].depth_limits


def _in_head(at: int, octets: bytes):
    """A change of the head at a byte behind its CRC, which is made right."""

    def change(unit: bytes) -> bytes:
        unit = unit[: 4 + at] + octets + unit[4 + at + len(octets) :]
        return struct.pack("<I", crc32(unit[4:HEAD])) + unit[4:]

    return change


PICTURES = HEAD = 0


@pytest.fixture(scope="module", autouse=True)
def _count(data):
    global PICTURES, HEAD
    sections = sections_of(data)
    PICTURES = struct.unpack_from("<H", next(s for kind, _, _, s in sections if kind == b"UNIT"))[0]
    HEAD = 4 + 8 * PICTURES
    HEAD += sum(40 * bool(s[10] & 16) + 16 * bool(s[10] & 2) for kind, _, _, s in sections if kind == b"LAYR")


HOSTILE = {
    "a picture longer than its view": (b"VIEW", 3, lambda unit: _in_head(HEAD - 12, b"\xff\xff\xff\x7f")(unit)),
    "a picture one byte shorter": (b"VIEW", 3, lambda unit: unit[:-1]),
    "bytes behind the pictures": (b"VIEW", 3, lambda unit: unit + b"\0"),
    "a head cut short": (b"VIEW", 3, lambda unit: unit[:50]),
    "an altered head": (b"VIEW", 3, lambda unit: unit[:9] + bytes([unit[9] ^ 1]) + unit[10:]),
    "no view": (b"VIEW", 3, lambda unit: b""),
    "a quaternion of another length": (b"VIEW", 0, _in_head(0, struct.pack("<f", 9.0))),
    "a focal length of 0": (b"VIEW", 0, _in_head(16, bytes(8))),
    "a picture twice": (b"UNIT", 0, lambda unit: unit[:6] + unit[4:6] + unit[8:]),
    "a layer that there is not": (b"UNIT", 0, lambda unit: unit[:4] + b"\x07" + unit[5:]),
    "a record that there is not": (b"UNIT", 0, lambda unit: unit[:5] + b"\xc8" + unit[6:]),
    "a picture too few": (b"UNIT", 0, lambda unit: struct.pack("<H", PICTURES - 1) + unit[2:-2]),
    "a list cut short": (b"UNIT", 0, lambda unit: unit[:-1]),
    "bytes behind the list": (b"UNIT", 0, lambda unit: unit + b"\0"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_an_index_that_lies_is_refused_in_one_line(data, case):
    kind, index, change = HOSTILE[case]
    with pytest.raises(FormatError) as caught:
        read_container(_changed(data, kind, change, index))
    message = str(caught.value)
    assert re.search(r"\b(UNIT|VIEW|LAYR)\[\d\]", message) and "\n" not in message
    with Decoder() as tsplat_js:
        assert tsplat_js(_changed(data, kind, change, index))[0]["error"] == "TsplatError"


def test_views_stand_once_in_order_and_behind_all_else(data):
    sections = sections_of(data)
    views = [n for n, section in enumerate(sections) if section[0] == b"VIEW"]
    swapped = list(sections)
    swapped[views[1]], swapped[views[2]] = sections[views[2]], sections[views[1]]
    cases = {
        "swapped": swapped,
        "missing": sections[: views[2]] + sections[views[3] :],
        "twice": [*sections, sections[views[0]]],
        "in front": [sections[views[0]], *sections[: views[0]], *sections[views[0] + 1 :]],
        "renumbered": [[k, f, 9 if (k, i) == (b"VIEW", 6) else i, d] for k, f, i, d in sections],
    }
    for broken in cases.values():
        with refusing(FormatError, "VIEW"):
            read_container(file_of(broken))
    with refusing(FormatError, "DEPT[0]"):
        read_container(file_of([*sections[: views[0]], [b"DEPT", 1, 0, b""], *sections[views[0] :]]))


def test_more_than_4096_views_are_refused_before_anything_is_taken(data):
    sections = sections_of(data)
    for section in sections:
        if section[0] == b"SCEN":
            section[3] = struct.pack("<H", 4097) + section[3][2:]
    with refusing(FormatError, "4097 4096"):
        read_container(file_of(sections))
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
    assert len(ts.decompress(data, max_bytes=ends[1] + HEAD - 1).cameras) == 2
    first = next(section for kind, _, index, section in sections_of(data) if (kind, index) == (b"VIEW", 0))
    start = ends[0] - len(first)
    for length in (HEAD - 1, HEAD):  # of no picture anything
        with pytest.raises(FormatError):
            ts.decompress(data, max_bytes=start + length)


def test_damage_costs_the_view_or_the_picture_that_it_hits_and_both_are_named(data):
    whole = ts.decompress(data)
    ends = [prefix["bytes"] for prefix in ts.inspect(data)["prefixes"]]
    damaged = bytearray(data)
    damaged[ends[1] + 6] ^= 1  # in the head of view 2
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
