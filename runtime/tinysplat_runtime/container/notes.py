"""The optional section with what a scene's maker says about it. Layout: docs/FORMAT.md, `NOTE`."""

from __future__ import annotations

import struct
from zlib import crc32

from ..errors import FormatError, InputError
from ..gaussian.notes import MAX_BYTES, NAMES, Notes
from . import layout as L
from .sections import Cursor

NOTES = b"NOTE"
NOTES_FIXED = struct.Struct("<HHH")
"""Bytes of unit, attribution and licence, whose UTF-8 follows in this order."""

_MINOR = 1
_PLACE = 2  # in the table, behind scene and cameras: metadata, in every prefix that shows anything


def added_bytes(notes: Notes) -> int:
    """By how much `with_notes` makes a file larger."""
    return L.TABLE_ROW.size + len(_section(notes)) if notes else 0


def with_notes(data: bytes, notes: Notes) -> bytes:
    """A file that our writer made, with the section added; the file itself where there is nothing to say."""
    if not notes:
        return data
    magic, major, _, count, _, _ = L.HEADER.unpack_from(data)
    rows = [data[at : at + L.TABLE_ROW.size] for at in range(L.HEADER.size, _table_end(count), L.TABLE_ROW.size)]
    lengths = [L.TABLE_ROW.unpack(row)[3] for row in rows[:_PLACE]]
    at = _table_end(count) + sum(lengths)
    section = _section(notes)
    rows.insert(_PLACE, L.TABLE_ROW.pack(NOTES, 0, 0, len(section), crc32(section)))
    table = b"".join(rows)
    head = L.HEADER.pack(magic, major, _MINOR, count + 1, 0, 0)[:-4]
    return b"".join(
        (head, crc32(head + table).to_bytes(4, "little"), table, data[_table_end(count) : at], section, data[at:])
    )


def read_notes(cursor: Cursor) -> Notes:
    """Parse and check a NOTE section."""
    lengths = cursor.unpack(NOTES_FIXED)
    texts = {}
    for name, length in zip(NAMES, lengths, strict=True):
        cursor.require(length <= MAX_BYTES[name], f"{name} of {length} bytes, at most {MAX_BYTES[name]}")
        try:
            texts[name] = bytes(cursor.take(length)).decode("utf-8")
        except UnicodeDecodeError:
            raise FormatError(f"{name} is not UTF-8", where=cursor.section.label) from None
    cursor.finish()
    try:
        return Notes(**texts)
    except InputError as error:
        raise FormatError(error.message, where=f"{cursor.section.label}: {error.where}") from None


def _section(notes: Notes) -> bytes:
    texts = [getattr(notes, name).encode() for name in NAMES]
    return NOTES_FIXED.pack(*map(len, texts)) + b"".join(texts)


def _table_end(count: int) -> int:
    return L.HEADER.size + count * L.TABLE_ROW.size
