"""The table of pictures: which there are, in the order of their bytes. Layout: docs/FORMAT.md, PICT.

A row is a channel of a layer or a tier, with a picture for every view. Lengths and CRCs of all stand in the table, or,
in a file in parts by view, in front of each view's pictures: who wants one view reads its bytes alone.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from zlib import crc32

from ..errors import FormatError
from ..gaussian.planes import MAX_DECODED, MAX_QP, PlaneClass
from ..system.jsonfields import JsonObject
from . import layout as L
from .records import ChannelRecord, Picture
from .sections import Cursor, NewSection, Section

Row = tuple[int, ChannelRecord]
"""Layer or tier, and its channel."""


@dataclass(frozen=True)
class Table:
    """The pictures of a file.

    Attributes:
        rows: (layer or tier, channel), in the order of their bytes.
        views: the numbers in the file of the views whose pictures these are; (0,) of a list.
        count: views of the file.
        parts: where each view's bytes lie in the file, (first, length), if they are in parts by view.
    """

    rows: tuple[Row, ...]
    views: tuple[int, ...]
    count: int
    parts: tuple[tuple[int, int], ...] = ()

    @cached_property
    def layers(self) -> Mapping[int, tuple[ChannelRecord, ...]]:
        """By layer or tier, its channels by class and target, whatever order their bytes have."""
        found: dict[int, list[ChannelRecord]] = {}
        for layer, record in sorted(self.rows, key=lambda row: row[1].key):
            found.setdefault(layer, []).append(record)
        return {layer: tuple(records) for layer, records in found.items()}

    def layer(self, number: int) -> tuple[ChannelRecord, ...]:
        """The channels of a layer or tier by class and target; none where it has none."""
        return self.layers.get(number, ())

    def payload(self, channel: ChannelRecord, view: int) -> memoryview:
        """A picture's bytes; FormatError where they are cut off or not those that were written."""
        return channel.pictures[view].checked(f"plane {channel.name}, view {self.views[view]}")

    def prefixes(self, step: Callable[[int, ChannelRecord, int], Hashable]) -> list[JsonObject]:
        """Useful numbers for `--max-bytes`: where a step ends, and what it adds to those before it.

        Rows of one step stand together: between them a prefix decodes as well, but can show less than without them.
        `step` is given the layer, the channel, and which one of its class it is.
        """
        if self.parts:
            ends = (start + length for start, length in self.parts)
            return [{"bytes": end, "views": view + 1} for view, end in enumerate(ends)]
        prefixes: list[JsonObject] = []
        counts: dict[tuple[int, PlaneClass], int] = {}
        before: Hashable = None
        for layer, record in self.rows:
            number = counts.get((layer, record.plane_class), 0)
            counts[layer, record.plane_class] = number + 1
            if not record.pictures:
                continue
            here = (layer, step(layer, record, number))
            if here != before:
                prefixes.append({"bytes": 0, "layer": layer, "adds": []})
            prefixes[-1]["bytes"] = record.pictures[-1].end
            if record.plane_class != PlaneClass.POSITION:
                prefixes[-1]["adds"].append(record.name)
            before = here
        return prefixes


@dataclass(frozen=True)
class Rows:
    """PICT as it stands, before pictures are looked for.

    Attributes:
        rows: layer or tier, channel, and whether it has pictures.
        views: of the file.
        by_view: whether the bytes are in parts by view.
        streams: (length, CRC) as the section ends with them.
        label: of the section, for messages.
    """

    rows: tuple[tuple[int, ChannelRecord, bool], ...]
    views: int
    by_view: bool
    streams: tuple[tuple[int, int], ...]
    label: str

    @classmethod
    def read(cls, section: Section) -> Rows:
        """Parse and check PICT; FormatError where it is damaged."""
        cursor = Cursor(section)
        count, views, by_view = cursor.unpack(L.PICTURES_FIXED)
        cursor.require(1 <= views <= L.MAX_VIEWS, f"{views} views, accepted are 1 to {L.MAX_VIEWS}")
        cursor.require(by_view <= 1, f"order {by_view} is unknown")
        rows = tuple(_read_row(cursor) for _ in range(count))
        coded = sum(is_coded for *_, is_coded in rows)
        taken = cursor.take(L.STREAM.size * (views if by_view else views * coded))
        cursor.finish()
        return cls(rows, views, bool(by_view), tuple(L.STREAM.iter_unpack(taken)), section.label)

    @property
    def table_bytes(self) -> int:
        """Bytes in front of a view's pictures, of a file in parts."""
        return L.STREAM.size * sum(is_coded for *_, is_coded in self.rows) * self.by_view

    def ranges(self, start: int) -> tuple[tuple[int, int], ...]:
        """(first byte, length) of each view's part, where pictures begin at `start`; none of a file in one part."""
        lengths = [length for length, _ in self.streams] if self.by_view else []
        return tuple(zip(accumulate(lengths, initial=start), lengths, strict=False))


def read_pictures(
    pict: Section,
    data: Section,
    wanted: Sequence[int] | None,
    *,
    is_prefix: bool,
    is_damaged: bool,
    fetched: Mapping[int, bytes | memoryview] | None,
) -> Table:
    """The pictures of the `wanted` views of a file, None for all.

    Args:
        pict, data: the sections PICT and DATA, of which the second may be cut off.
        wanted: views that there are.
        is_prefix: leave out views whose own table is cut off.
        is_damaged: leave out views whose own table is damaged, and pictures whose CRC differs.
        fetched: parts by view, in place of `data`.

    Raises:
        FormatError: damaged, of other lengths than the table says, or without any view that can be read.
    """
    found = Rows.read(pict)
    total = sum(length for length, _ in found.streams)
    if total != data.length:
        raise FormatError(f"{data.length} bytes, its pictures need {total}", where=data.label)
    start, views = data.end - data.length, tuple(range(found.views)) if wanted is None else tuple(wanted)
    if not found.by_view:
        pictures = _placed(found.streams, data.data, start, is_damaged)
        return Table(_rows(found, pictures, range(found.views), views), views, found.views)
    ranges, held = found.ranges(start), {}
    for view in views:
        first, length = ranges[view]
        part = data.data[first - start : first - start + length] if fetched is None else _fetched(fetched, view, length)
        own = _part(found, view, part, first, is_prefix=is_prefix, is_damaged=is_damaged)
        if own is not None:
            held[view] = own
    if not held:
        end = min(ranges[view][0] for view in views) + found.table_bytes
        raise FormatError(f"holds no intact view; the table of the first ends at byte {end}", where="file")
    by_row = [picture for row in zip(*held.values(), strict=True) for picture in row]
    return Table(_rows(found, by_row, tuple(held), tuple(held)), tuple(held), found.views, ranges)


def _part(
    found: Rows, view: int, part: memoryview, start: int, *, is_prefix: bool, is_damaged: bool
) -> list[Picture] | None:
    """The pictures of a view, of its part from byte `start` of the file on; None where its table is not at hand."""
    length, crc = found.streams[view]
    table, where = part[: found.table_bytes], f"view {view}"
    if length < found.table_bytes:
        raise FormatError(f"{length} bytes, its table has {found.table_bytes}", where=where)
    is_here = len(table) == found.table_bytes
    if not is_here or crc32(table) != crc:
        if is_damaged or (is_prefix and not is_here):
            return None
        reason = "CRC of its table differs: the bytes were altered" if is_here else f"{len(part)} bytes: cut short"
        raise FormatError(reason, where=where)
    streams = tuple(L.STREAM.iter_unpack(table))
    needed = found.table_bytes + sum(size for size, _ in streams)
    if needed != length:
        raise FormatError(f"{length} bytes, its table and pictures have {needed}", where=where)
    return _placed(streams, part[found.table_bytes :], start + found.table_bytes, is_damaged)


def _read_row(cursor: Cursor) -> tuple[int, ChannelRecord, bool]:
    layer, number, target, qp, scale, offset = cursor.unpack(L.CHANNEL)
    cursor.require(number in list(PlaneClass), f"plane class {number}, known are 0 to {max(PlaneClass):d}")
    record = ChannelRecord(PlaneClass(number), target, qp, scale, offset)
    cursor.require(qp <= MAX_QP or qp == L.CONSTANT, f"QP {qp}, accepted are 0 to {MAX_QP}")
    is_finite = abs(scale) < MAX_DECODED and abs(offset) < MAX_DECODED
    cursor.require(is_finite, f"{record.name}: scale or offset out of range")
    return layer, record, qp != L.CONSTANT


def _placed(streams: Sequence[tuple[int, int]], data: memoryview, start: int, is_damaged: bool) -> list[Picture]:
    """Pictures one behind the other, the first at byte `start` of the file and of `data`'s beginning."""
    pictures, at = [], 0
    for length, crc in streams:
        found = data[at : at + length]
        is_here = len(found) == length and not (is_damaged and crc32(found) != crc)
        at += length
        pictures.append(Picture(found if is_here else None, length, crc, start + at))
    return pictures


def _rows(found: Rows, pictures: Sequence[Picture], held: Sequence[int], views: Sequence[int]) -> tuple[Row, ...]:
    """Rows with the pictures of `views`; `pictures` are those of the views `held`, row by row."""
    place_of = {view: place for place, view in enumerate(held)}
    rows, at, places = [], 0, [place_of[view] for view in views]
    for layer, record, is_coded in found.rows:
        own: tuple[Picture, ...] = ()
        if is_coded:
            own = tuple(pictures[at + place] for place in places)
            at += len(held)
        rows.append((layer, ChannelRecord(*record.key, record.qp, record.scale, record.offset, own)))
    return tuple(rows)


def _fetched(parts: Mapping[int, bytes | memoryview], view: int, length: int) -> memoryview:
    data = memoryview(parts.get(view, b""))
    if view in parts and len(data) != length:
        raise FormatError(f"needs {length} bytes, {len(data)} are given", where=f"view {view}")
    return data


def picture_sections(rows: Sequence[Row], views: int, *, by_view: bool) -> list[NewSection]:
    """PICT and DATA of rows with a picture for each of so many views."""
    fixed = L.PICTURES_FIXED.pack(len(rows), views, by_view)
    for layer, channel in rows:
        qp = channel.qp if channel.pictures else L.CONSTANT
        fixed += L.CHANNEL.pack(layer, channel.plane_class, channel.target, qp, channel.scale, channel.offset)
    coded = [channel.pictures for _, channel in rows if channel.pictures]
    parts: list[bytes | memoryview]
    if by_view:
        own = [list(each) for each in zip(*coded, strict=True)] or [[] for _ in range(views)]
        tables = [_streams(pictures) for pictures in own]
        parts = [b"".join((table, *_data(pictures))) for table, pictures in zip(tables, own, strict=True)]
        ends = b"".join(L.STREAM.pack(len(part), crc32(table)) for part, table in zip(parts, tables, strict=True))
    else:
        every = [picture for pictures in coded for picture in pictures]
        parts, ends = _data(every), _streams(every)
    return [NewSection(L.PICTURES, 0, fixed + ends), NewSection(L.DATA, 0, b"".join(parts))]


def _data(pictures: Sequence[Picture]) -> list[bytes | memoryview]:
    return [picture.data or b"" for picture in pictures]


def _streams(pictures: Sequence[Picture]) -> bytes:
    return b"".join(L.STREAM.pack(picture.length, picture.crc) for picture in pictures)
