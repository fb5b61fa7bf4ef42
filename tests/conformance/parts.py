"""A file rewritten as one whose views are units (docs/FORMAT.md, UNIT), from the specification alone."""

from __future__ import annotations

import struct
from zlib import crc32

from sections import sections_of

from tinysplat_runtime.container import layout as L

OWN, RELATIVE, MIX, BASIS = L.OWN_INTRINSICS, L.RELATIVE_ROTATION, L.SCALE_MIX, L.BASIS


def in_parts(data: bytes) -> bytes:
    """The same scene with a section VIEW per view."""
    sections = sections_of(data)
    views = struct.unpack("<H", next(d for k, _, _, d in sections if k == b"SCEN")[:2])[0]
    classes = dict(enumerate((b"DEPT", b"COLO", b"OPAC", b"SCAL", b"ROTA", b"OFFS")))
    fixed = [b""] * views
    metadata, pictures, order = [], [], []
    for kind, flags, index, text in sections:
        if kind in classes.values():
            continue
        if kind == b"LAYR":
            text, own, found = _layer(text, views)
            fixed = [before + added for before, added in zip(fixed, own, strict=True)]
            ends = dict.fromkeys(classes, 0)
            joined = {
                number: b"".join(d for k, _, i, d in sections if k == name and i % L.PART == index)
                for number, name in classes.items()
            }
            for record, number, lengths in found:
                order.append((index, record))
                row = []
                for length in lengths:
                    row.append(joined[number][ends[number] : ends[number] + length])
                    ends[number] += length
                pictures.append(row)
        metadata.append([kind, flags, index, text])
    backwards = list(range(len(order)))[::-1]  # any order will do, and this one is no writer's
    unit = struct.pack("<HH", len(order), 0) + b"".join(bytes(order[n]) for n in backwards)
    units = []
    for view in range(views):
        mine = [pictures[n][view] for n in backwards]
        head = fixed[view] + b"".join(struct.pack("<II", len(picture), crc32(picture)) for picture in mine)
        units.append([b"VIEW", L.REQUIRED, view, struct.pack("<I", crc32(head)) + head + b"".join(mine)])
    return _file([*metadata, [b"UNIT", L.REQUIRED, 0, unit], *units], 5)


def _layer(text: bytes, views: int) -> tuple[bytes, list[bytes], list[tuple[int, int, list[int]]]]:
    """LAYR without what belongs to views, that by view, and (record, class, lengths of pictures)."""
    degree, flags, count, k = text[8], text[10], *struct.unpack("<HH", text[12:16])
    at, own = 32, [b""] * views
    for flag, size in ((OWN, 40), (RELATIVE, 16)):
        if flags & flag:
            own = [before + text[at + size * n : at + size * (n + 1)] for n, before in enumerate(own)]
            at += size * views
    maps = 48 * bool(flags & MIX) + 2 * 3 * (degree + 1) ** 2 * k * bool(flags & BASIS)
    kept, at, found = text[:32] + text[at : at + maps], at + maps, []
    for record in range(count):
        kept += text[at : at + 12]
        number, coding = text[at], text[at + 2]
        at += 12
        if coding:
            rows = [struct.unpack("<II", text[at + 8 * n : at + 8 * n + 8])[0] for n in range(views)]
            found.append((record, number, rows))
            at += 8 * views
    return kept, own, found


def _file(sections: list[list], minor: int) -> bytes:
    table = b"".join(L.TABLE_ROW.pack(k, f, i, len(d), crc32(d)) for k, f, i, d in sections)
    head = L.HEADER.pack(L.MAGIC, L.MAJOR, minor, len(sections), 0, 0)[:-4]
    return head + struct.pack("<I", crc32(head + table)) + table + b"".join(d for *_, d in sections)
