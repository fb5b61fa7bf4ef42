"""A file as its sections: header and table checked, bytes found, numbers read off them.

Part of the trust boundary of reader.py: no length is believed before it is compared with the bytes that are there.
Numbers by view stand column by column: once where all views have the same, and as float32 where that loses nothing
(docs/FORMAT.md, "Columns").
"""

import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from . import layout as L


@dataclass(frozen=True)
class NewSection:
    """A section to be written.

    Attributes:
        is_required: a reader that does not know it must refuse the file.
    """

    kind: bytes
    index: int
    data: bytes
    is_required: bool = True


@dataclass(frozen=True)
class Section:
    """One row of the table and its bytes.

    Attributes:
        length: bytes that the table states; `data` has fewer where a prefix of the file ends in or before the section.
        end: where the section ends in the file.
    """

    kind: bytes
    index: int
    length: int
    crc: int
    end: int
    data: memoryview

    @property
    def label(self) -> str:
        """For messages."""
        return f"section {self.kind.decode('ascii', 'replace')}[{self.index}]"


class Cursor:
    """Reads structures off a section, never past its end."""

    def __init__(self, section: Section) -> None:
        self.section, self.at = section, 0

    def take(self, count: int) -> memoryview:
        """The next bytes."""
        left = len(self.section.data) - self.at
        if count > left:
            raise FormatError(f"at byte {self.at} needs {count} bytes, {left} remain", where=self.section.label)
        self.at += count
        return self.section.data[self.at - count : self.at]

    def unpack(self, fields: struct.Struct) -> tuple:
        """The next structure."""
        return fields.unpack(self.take(fields.size))

    def require(self, condition: bool, message: str) -> None:
        """FormatError with the message and the section's name, unless the condition holds."""
        require(condition, self.section, message)

    def finish(self) -> None:
        """FormatError if bytes are left."""
        if self.at != len(self.section.data):
            raise FormatError(f"{len(self.section.data) - self.at} bytes too many", where=self.section.label)


def table_end(view: memoryview) -> int:
    """Where the section table ends, of the file's first bytes, at least those of the header.

    Raises:
        FormatError: foreign, cut short, of an unknown version, or with more sections than a file may have.
    """
    if not L.MAGIC.startswith(view[: len(L.MAGIC)]):
        raise FormatError(f"not a .tsplat file (starts with {bytes(view[:8])!r})", where="header")
    if not view:
        raise FormatError("an empty file", where="header")
    if len(view) < L.HEADER.size:
        raise FormatError(f"needs {L.HEADER.size} bytes, there are {len(view)}: cut short", where="header")
    _, major, minor, count, *_ = L.HEADER.unpack(view[: L.HEADER.size])
    if major != L.MAJOR:
        raise FormatError(f"format version {major}.{minor}, this reader knows {L.MAJOR}.x", where="header")
    if count > L.MAX_SECTIONS:
        raise FormatError(f"{count} sections do not fit in {len(view)} bytes: cut short?", where="section table")
    return L.HEADER.size + count * L.TABLE_ROW.size


def _rows(view: memoryview) -> Iterator[tuple[bytes, int, int, int, int, int]]:
    """Type, flags, index, length, CRC and end of every section."""
    end = table_end(view)
    *_, count, _, crc = L.HEADER.unpack(view[: L.HEADER.size])
    if end > len(view):
        raise FormatError(f"{count} sections do not fit in {len(view)} bytes: cut short?", where="section table")
    table = view[L.HEADER.size : end]
    if crc32(table, crc32(view[: L.HEADER.size - 4])) != crc:
        raise FormatError("CRC differs: the header was altered", where="header")
    for kind, flags, index, length, section_crc in L.TABLE_ROW.iter_unpack(table):
        end += length
        yield kind, flags, index, length, section_crc, end


def read_table(
    view: memoryview, known: Collection[bytes], *, is_prefix: bool
) -> tuple[tuple[int, int], int, list[Section]]:
    """Parse and check header and table.

    Args:
        view: the file, or its first bytes.
        known: section types to return; others are skipped, or refused where they are required.
        is_prefix: accept a file that ends before its table says, in its last section, DATA.

    Returns:
        Version, bytes of the whole file, and the known sections, the CRC of each checked but of DATA.
    """
    sections, end, last = [], table_end(view), b""
    for last, flags, index, length, crc, end in _rows(view):
        section = Section(last, index, length, crc, end, view[end - length : end])
        if len(section.data) != length and not is_prefix:
            raise FormatError(f"needs {length} bytes, {len(section.data)} remain: cut short", where=section.label)
        if last in known:
            sections.append(section)
        elif flags & L.REQUIRED:
            raise FormatError("unknown and required; a newer reader is needed", where=section.label)
    if end < len(view):
        raise FormatError(f"{len(view) - end} bytes behind the last section", where="file")
    if last != L.DATA:
        raise FormatError("expected as the last section", where="section DATA[0]")
    metadata = [section for section in sections if section.kind != L.DATA]
    metadata_end = end - sections[-1].length
    if metadata_end > len(view):
        raise FormatError(
            f"the first {len(view)} bytes hold no picture; the metadata alone takes {metadata_end}", where="file"
        )
    for section in metadata:
        if crc32(section.data) != section.crc:
            raise FormatError("CRC differs: the bytes were altered", where=section.label)
    _, major, minor, *_ = L.HEADER.unpack(view[: L.HEADER.size])
    return (major, minor), end, sections


def only(sections: Sequence[Section], kind: bytes, index: int = 0) -> Section:
    """The one section of a type and index; FormatError if it is missing or there more than once."""
    found = [s for s in sections if s.kind == kind and s.index == index]
    if len(found) != 1:
        label = f"section {kind.decode('ascii')}[{index}]"
        raise FormatError("missing" if not found else f"stands {len(found)} times, expected once", where=label)
    return found[0]


def require(condition: bool, section: Section, message: str) -> None:
    """FormatError with the message and the section's name, unless the condition holds."""
    if not condition:
        raise FormatError(message, where=section.label)


def packed_columns(values: NDArray) -> bytes:
    """The bytes of (V, C) float64 numbers."""
    parts = []
    for column in values.T:
        with np.errstate(over="ignore"):
            narrow = column.astype("<f4")
        form = L.NARROW * (narrow.astype(np.float64).tobytes() == column.tobytes())
        stored = narrow if form else column.astype("<f8")
        is_same = stored.tobytes() == stored[:1].tobytes() * len(stored)
        form |= L.PER_VIEW * (not is_same)
        parts += [L.COLUMN.pack(form), (stored[:1] if is_same else stored).tobytes()]
    return b"".join(parts)


def read_columns(cursor: Cursor, views: int, columns: int) -> NDArray:
    """(V, C) float64 numbers, of which nothing is known yet; FormatError where there are too few."""
    values = np.empty((views, columns))
    for column in range(columns):
        (form,) = cursor.unpack(L.COLUMN)
        cursor.require(form <= L.PER_VIEW | L.NARROW, f"a column stored as {form}, known are 0 to 3")
        dtype = np.dtype("<f4" if form & L.NARROW else "<f8")
        count = views if form & L.PER_VIEW else 1
        with np.errstate(invalid="ignore"):  # signalling NaN
            values[:, column] = np.frombuffer(cursor.take(count * dtype.itemsize), dtype)
    return values
