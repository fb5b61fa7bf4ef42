"""A `.tsplat` file taken apart and put together again, for tests that tamper with it."""

from __future__ import annotations

import struct
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


def file_of(sections: list[list], major: int = L.MAJOR) -> bytes:
    """A file of such sections, its checksums right."""
    table = b"".join(L.TABLE_ROW.pack(k, f, i, len(d), crc32(d)) for k, f, i, d in sections)
    head = L.HEADER.pack(L.MAGIC, major, L.MINOR, len(sections), 0, 0)[:-4]
    return head + struct.pack("<I", crc32(head + table)) + table + b"".join(d for *_, d in sections)
