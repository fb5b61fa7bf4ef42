"""The table of pictures: which there are, in the order of their bytes. Layout: docs/FORMAT.md, PICT.

A row is a channel of a layer or a tier, with a picture for every view.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
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
    """

    rows: tuple[Row, ...]
    views: tuple[int, ...]
    count: int

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


def read_pictures(pict: Section, data: Section, wanted: Sequence[int] | None, *, is_damaged: bool) -> Table:
    """The pictures of the `wanted` views of a file, None for all.

    Args:
        pict, data: the sections PICT and DATA, of which the second may be cut off.
        wanted: views that there are.
        is_damaged: leave out pictures whose CRC differs.

    Raises:
        FormatError: damaged, or of other lengths than the table says.
    """
    cursor = Cursor(pict)
    count, views, order = cursor.unpack(L.PICTURES_FIXED)
    cursor.require(1 <= views <= L.MAX_VIEWS, f"{views} views, accepted are 1 to {L.MAX_VIEWS}")
    cursor.require(order == 0, f"order {order} is unknown")
    rows = [_read_row(cursor) for _ in range(count)]
    coded = sum(is_coded for *_, is_coded in rows)
    streams = list(L.STREAM.iter_unpack(cursor.take(L.STREAM.size * views * coded)))
    cursor.finish()
    total = sum(length for length, _ in streams)
    if total != data.length:
        raise FormatError(f"{data.length} bytes, its pictures need {total}", where=data.label)
    chosen = tuple(range(views)) if wanted is None else tuple(wanted)
    pictures, at, found = _placed(streams, data.data, data.end - data.length, is_damaged), 0, []
    for layer, record, is_coded in rows:
        own = tuple(pictures[at + view] for view in chosen) if is_coded else ()
        at += views * is_coded
        found.append((layer, replace(record, pictures=own)))
    return Table(tuple(found), chosen, views)


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


def picture_sections(rows: Sequence[Row], views: int) -> list[NewSection]:
    """PICT and DATA of rows with a picture for each of so many views."""
    text = L.PICTURES_FIXED.pack(len(rows), views, 0)
    for layer, channel in rows:
        qp = channel.qp if channel.pictures else L.CONSTANT
        text += L.CHANNEL.pack(layer, channel.plane_class, channel.target, qp, channel.scale, channel.offset)
    pictures = [picture for _, channel in rows for picture in channel.pictures]
    text += b"".join(L.STREAM.pack(picture.length, picture.crc) for picture in pictures)
    data = b"".join(picture.data or b"" for picture in pictures)
    return [NewSection(L.PICTURES, 0, text), NewSection(L.DATA, 0, data)]
