"""The optional section with what is said about a scene: named texts. Layout: docs/FORMAT.md, `NOTE`."""

import struct
from collections.abc import Sequence

from ..errors import FormatError, InputError
from ..gaussian.notes import NAMES, NO_NOTES, Notes
from .sections import Cursor, NewSection, Section, only

NOTES = b"NOTE"

NOTE_FIXED = struct.Struct("<BH")
"""Bytes of a name in ASCII and of its text in UTF-8, which follow."""

MAX_FIELDS = 64


def note_sections(notes: Notes) -> list[NewSection]:
    """The section, where there is something to say."""
    texts = {name.encode(): text.encode() for name, text in notes.given().items()}
    data = b"".join(NOTE_FIXED.pack(len(name), len(text)) + name + text for name, text in texts.items())
    return [NewSection(NOTES, 0, data, is_required=False)] if texts else []


def read_notes(sections: Sequence[Section]) -> Notes:
    """Parse and check the section, which need not be there; names that are not known here are skipped."""
    if not any(section.kind == NOTES for section in sections):
        return NO_NOTES
    cursor = Cursor(only(sections, NOTES))
    texts: dict[str, str] = {}
    while cursor.at < len(cursor.section.data):
        name_bytes, text_bytes = cursor.unpack(NOTE_FIXED)
        raw, text = bytes(cursor.take(name_bytes)), _text(cursor, text_bytes)
        name = raw.decode("latin-1")
        cursor.require(raw.isascii() and name.isalpha() and name.islower(), f"a name {name!r:.40}, expected a to z")
        cursor.require(name not in texts and len(texts) < MAX_FIELDS, f"{name} twice, or more than {MAX_FIELDS} fields")
        texts[name] = text
    try:
        return Notes(**{name: text for name, text in texts.items() if name in NAMES})
    except InputError as error:
        raise FormatError(error.message, where=f"{cursor.section.label}: {error.where}") from None


def _text(cursor: Cursor, length: int) -> str:
    try:
        return bytes(cursor.take(length)).decode("utf-8")
    except UnicodeDecodeError:
        raise FormatError("a text that is not UTF-8", where=cursor.section.label) from None
