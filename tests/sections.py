"""A `.tsplat` file taken apart and put together again, by docs/FORMAT.md, for tests that tamper with it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
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
    """A picture: its row and view, where it lies in DATA, and where its length and CRC stand: in PICT, or in DATA."""

    row: tuple[int, ...]
    view: int
    start: int
    length: int
    is_in_data: bool
    at: int


@dataclass(frozen=True)
class Pict:
    """The table of pictures.

    Attributes:
        rows: layer, class, target, QP, scale and offset of each.
        views: of the file.
        by_view: whether DATA is in parts.
        parts: of such a file, (start, length) in DATA, and how many bytes the table in front of each has.
        places: of all pictures, in the order of their bytes.
    """

    rows: tuple[tuple, ...]
    views: int
    by_view: bool
    parts: tuple[tuple[int, int], ...]
    table_bytes: int
    places: tuple[Place, ...]

    @classmethod
    def of(cls, data: bytes) -> Pict:
        """Read a valid file's."""
        texts = {kind: text for kind, _, _, text in sections_of(data)}
        pict, bytes_of = texts[b"PICT"], texts[b"DATA"]
        count, views, by_view = struct.unpack_from("<HHH", pict)
        rows = tuple(struct.unpack_from("<BBBBff", pict, 6 + 12 * n) for n in range(count))
        coded = [row for row in rows if row[3] != 255]
        at = 6 + 12 * count
        if not by_view:
            each = [(row, view) for row in coded for view in range(views)]
            return cls(rows, views, False, (), 0, tuple(_places(pict, at, each, 0, False)))
        lengths = [struct.unpack_from("<I", pict, at + 8 * view)[0] for view in range(views)]
        parts = tuple(zip(accumulate(lengths, initial=0), lengths, strict=False))
        size, places = 8 * len(coded), []
        for view, (start, _) in enumerate(parts):
            places += _places(bytes_of, start, [(row, view) for row in coded], start + size, True)
        return cls(rows, views, True, parts, size, tuple(places))


def _places(text: bytes, at: int, each: list[tuple[tuple, int]], start: int, is_in_data: bool) -> list[Place]:
    places = []
    for n, (row, view) in enumerate(each):
        (length,) = struct.unpack_from("<I", text, at + 8 * n)
        places.append(Place(row, view, start, length, is_in_data, at + 8 * n))
        start += length
    return places


def with_picture(data: bytes, place: Place, picture: bytes) -> bytes:
    """The file with another picture of the same length, all checksums right."""
    found, sections = Pict.of(data), sections_of(data)
    pict, pictures = (next(s for s in sections if s[0] == kind) for kind in (b"PICT", b"DATA"))
    texts = {False: bytearray(pict[3]), True: bytearray(pictures[3])}
    texts[True][place.start : place.start + place.length] = picture
    texts[place.is_in_data][place.at + 4 : place.at + 8] = struct.pack("<I", crc32(picture))
    if found.by_view:
        start, _ = found.parts[place.view]
        at = 6 + 12 * len(found.rows) + 8 * place.view + 4
        texts[False][at : at + 4] = struct.pack("<I", crc32(texts[True][start : start + found.table_bytes]))
    pict[3], pictures[3] = bytes(texts[False]), bytes(texts[True])
    return file_of(sections)


def repacked(
    data: bytes,
    order: Callable[[list[int]], list[int]] = list,
    by_view: bool = False,
    change: Callable[[bytes], bytes] = bytes,
) -> bytes:
    """The file with its rows in another order, its pictures changed, and these in one part or in parts by view."""
    found, sections = Pict.of(data), sections_of(data)
    pict, pictures = (next(s for s in sections if s[0] == kind) for kind in (b"PICT", b"DATA"))
    held = {(p.row, p.view): change(pictures[3][p.start : p.start + p.length]) for p in found.places}
    rows = [found.rows[n] for n in order(list(range(len(found.rows))))]
    coded = [row for row in rows if row[3] != 255]

    def entries(payloads: list[bytes]) -> bytes:
        return b"".join(struct.pack("<II", len(payload), crc32(payload)) for payload in payloads)

    fixed = struct.pack("<HHH", len(rows), found.views, by_view) + b"".join(struct.pack("<BBBBff", *r) for r in rows)
    if by_view:
        own = [[held[row, view] for row in coded] for view in range(found.views)]
        parts = [entries(payloads) + b"".join(payloads) for payloads in own]
        tables = zip(parts, map(entries, own), strict=True)
        pict[3] = fixed + b"".join(struct.pack("<II", len(part), crc32(table)) for part, table in tables)
    else:
        parts = [held[row, view] for row in coded for view in range(found.views)]
        pict[3] = fixed + entries(parts)
    pictures[3] = b"".join(parts)
    return file_of(sections)
