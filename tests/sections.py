"""A `.tsplat` file taken apart and put together again, by docs/FORMAT.md, for tests that tamper with it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from zlib import crc32

from tinysplat_runtime.container import layout as L


def sections_of(data: bytes) -> list[list]:
    """[type, flags, index, bytes] of every section."""
    count = L.HEADER.unpack(data[: L.HEADER.size])[3]
    at = L.HEADER.size + count * L.TABLE_ROW.size
    sections = []
    for row in range(count):
        start = L.HEADER.size + row * L.TABLE_ROW.size
        kind, flags, index, length, _ = L.TABLE_ROW.unpack(data[start : start + L.TABLE_ROW.size])
        sections.append([kind, flags, index, data[at : at + length]])
        at += length
    return sections


def file_of(sections: list[list], major: int = L.MAJOR, minor: int = L.MINOR) -> bytes:
    """A file of such sections, its checksums right."""
    table = b"".join(L.TABLE_ROW.pack(k, f, i, len(d), crc32(d)) for k, f, i, d in sections)
    head = L.HEADER.pack(L.MAGIC, major, minor, len(sections), 0, 0)[:-4]
    return head + struct.pack("<I", crc32(head + table)) + table + b"".join(d for *_, d in sections)


def beside(data: bytes, *more: list) -> bytes:
    """The file with more sections in front of its pictures."""
    *metadata, pictures = sections_of(data)
    return file_of([*metadata, *more, pictures])


def changed_section(data: bytes, kind: bytes, change: Callable[[bytearray], object], index: int = 0) -> bytes:
    """The file with the bytes of one section changed, checksums right."""
    sections = sections_of(data)
    section = next(s for s in sections if (s[0], s[2]) == (kind, index))
    text = bytearray(section[3])
    change(text)
    section[3] = bytes(text)
    return file_of(sections)


@dataclass(frozen=True)
class Place:
    """A picture: its row and view, where it lies in DATA, and where its length and CRC stand in PICT."""

    row: tuple[int, ...]
    view: int
    start: int
    length: int
    at: int


@dataclass(frozen=True)
class Pict:
    """The table of pictures.

    Attributes:
        rows: layer, class, target, QP, scale and offset of each.
        views: of the file.
        places: of all pictures, in the order of their bytes.
    """

    rows: tuple[tuple, ...]
    views: int
    places: tuple[Place, ...]

    @classmethod
    def of(cls, data: bytes) -> Pict:
        """Read a valid file's."""
        pict = next(text for kind, _, _, text in sections_of(data) if kind == b"PICT")
        count, views = struct.unpack_from("<HH", pict)
        rows = tuple(struct.unpack_from("<BBBBff", pict, 6 + 12 * n) for n in range(count))
        places, at, start = [], 6 + 12 * count, 0
        for row in (row for row in rows if row[3] != 255):
            for view in range(views):
                (length,) = struct.unpack_from("<I", pict, at)
                places.append(Place(row, view, start, length, at))
                start, at = start + length, at + 8
        return cls(rows, views, tuple(places))


def with_picture(data: bytes, place: Place, picture: bytes) -> bytes:
    """The file with another picture of the same length, all checksums right."""
    sections = sections_of(data)
    pict, pictures = (next(s for s in sections if s[0] == kind) for kind in (b"PICT", b"DATA"))
    table, held = bytearray(pict[3]), bytearray(pictures[3])
    held[place.start : place.start + place.length] = picture
    table[place.at + 4 : place.at + 8] = struct.pack("<I", crc32(picture))
    pict[3], pictures[3] = bytes(table), bytes(held)
    return file_of(sections)


def repacked(
    data: bytes, order: Callable[[list[int]], list[int]] = list, change: Callable[[bytes], bytes] = bytes
) -> bytes:
    """The file with its rows in another order, its pictures changed."""
    found, sections = Pict.of(data), sections_of(data)
    pict, pictures = (next(s for s in sections if s[0] == kind) for kind in (b"PICT", b"DATA"))
    held = {(p.row, p.view): change(pictures[3][p.start : p.start + p.length]) for p in found.places}
    rows = [found.rows[n] for n in order(list(range(len(found.rows))))]
    each = [held[row, view] for row in rows if row[3] != 255 for view in range(found.views)]
    table = struct.pack("<HHH", len(rows), found.views, 0) + b"".join(struct.pack("<BBBBff", *row) for row in rows)
    pict[3] = table + b"".join(struct.pack("<II", len(payload), crc32(payload)) for payload in each)
    pictures[3] = b"".join(each)
    return file_of(sections)
