"""The optional sections with what is said about a scene. Layout: docs/FORMAT.md, `NOTE`, `REFI`, `ANTI`, `THIN`."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from ..errors import FormatError, InputError
from ..gaussian.notes import MAX_BYTES, NO_NOTES, Notes
from .sections import Cursor, NewSection, Section, only

NOTES = b"NOTE"
REFINED = b"REFI"
ANTIALIASED = b"ANTI"
THINNED = b"THIN"

NOTES_FIXED = struct.Struct("<HHH")
"""Bytes of unit, attribution and licence, whose UTF-8 follows in this order."""

NOTE_NAMES = ("unit", "attribution", "licence")

TEXTS = {REFINED: "refined", ANTIALIASED: "antialiased", THINNED: "thinned"}
"""Sections of one text each, and the note that it is."""

MINOR = {NOTES: 1, REFINED: 2, ANTIALIASED: 3, THINNED: 5}
"""Minor version of a file with such a section, which readers that do not know it may skip."""


def note_sections(notes: Notes) -> list[NewSection]:
    """The sections that there is something to say in."""
    texts = [getattr(notes, name).encode() for name in NOTE_NAMES]
    found = {NOTES: NOTES_FIXED.pack(*map(len, texts)) + b"".join(texts)} if any(texts) else {}
    single = {kind: getattr(notes, name).encode() for kind, name in TEXTS.items()}
    found |= {kind: text for kind, text in single.items() if text}
    return [NewSection(kind, 0, data, MINOR[kind], is_required=False) for kind, data in found.items()]


def read_notes(sections: Sequence[Section]) -> Notes:
    """Parse and check the sections NOTE, REFI, ANTI and THIN of a file, which need not be there."""
    kinds = {section.kind for section in sections}
    texts = _read_texts(Cursor(only(sections, NOTES))) if NOTES in kinds else {}
    for kind, name in TEXTS.items():
        if kind in kinds:
            cursor = Cursor(only(sections, kind))
            length, most = len(cursor.section.data), MAX_BYTES[name]
            cursor.require(1 <= length <= most, f"{length} bytes, expected 1 to {most}")
            texts[name] = _text(cursor, name, length)
    if not texts:
        return NO_NOTES
    try:
        return Notes(**texts)
    except InputError as error:
        kind = next((kind for kind, name in TEXTS.items() if name == error.where), NOTES)
        label = only(sections, kind).label
        raise FormatError(error.message, where=f"{label}: {error.where}") from None


def _read_texts(cursor: Cursor) -> dict[str, str]:
    lengths = cursor.unpack(NOTES_FIXED)
    texts = {}
    for name, length in zip(NOTE_NAMES, lengths, strict=True):
        cursor.require(length <= MAX_BYTES[name], f"{name} of {length} bytes, at most {MAX_BYTES[name]}")
        texts[name] = _text(cursor, name, length)
    cursor.finish()
    return texts


def _text(cursor: Cursor, name: str, length: int) -> str:
    try:
        return bytes(cursor.take(length)).decode("utf-8")
    except UnicodeDecodeError:
        raise FormatError(f"{name} is not UTF-8", where=cursor.section.label) from None
