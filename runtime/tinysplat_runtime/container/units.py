"""Views as units of random access: sections UNIT and VIEW. Layout: docs/FORMAT.md, "Views as units".

A reader takes the views that are wanted, of those whose bytes are at hand; nothing of the others is looked at.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from zlib import crc32

from ..errors import FormatError
from ..gaussian.planes import BACK_TO_FRONT, CODING_ORDER, PASSES, PlaneClass
from . import layout as L
from .body import Opened
from .free import FREE_POINTS
from .layers import CodedLayer, PerView, layer_flags, view_fields
from .records import ChannelRecord, StreamRef, UnitPictures, pass_of
from .sections import Cursor, NewSection, Section

UNIT_KINDS = frozenset({L.UNITS, L.VIEW})

READ_LATER = frozenset(L.PLANES.values()) | {L.VIEW, FREE_POINTS}
"""Sections that a prefix may lack; what they hold has CRCs of its own."""

UNITS_MINOR = 5
"""Minor version of a file whose views are units."""

MOST_TOGETHER = 6
"""Views of which a file is read as a whole: as many as a network takes at once."""


@dataclass(frozen=True)
class _Head:
    """What a view's section says of its pictures, by layer or by (layer, record)."""

    intrinsics: dict[int, tuple[float, ...]]
    quats: dict[int, tuple[float, ...]]
    streams: dict[tuple[int, int], StreamRef]


@dataclass(frozen=True)
class Units:
    """The views of a file that are read, in the order in which they are wanted."""

    sections: tuple[Section, ...]
    heads: tuple[_Head, ...]

    @classmethod
    def read(cls, file: Opened) -> Units:
        """Parse and check UNIT, and the heads of the views that `file` wants.

        Raises:
            FormatError: they are damaged, or sections VIEW are not each there once, in order and behind all others.
        """
        order, fields = _order(Cursor(file.only(L.UNITS)), file.layer_count), _fields(file)
        units = check_units(file)
        wanted = tuple(units[view] for view in file.wanted)
        return cls(wanted, tuple(_head(section, order, fields) for section in wanted))

    def layer(self, index: int) -> PerView:
        """What layer `index` has for each view."""
        records = [record for layer, record in self.heads[0].streams if layer == index]
        return PerView(
            [head.intrinsics[index] for head in self.heads if index in head.intrinsics],
            [head.quats[index] for head in self.heads if index in head.quats],
            {record: tuple(head.streams[index, record] for head in self.heads) for record in records},
        )

    def pictures(self, channels: Sequence[tuple[ChannelRecord, ...]]) -> UnitPictures:
        """The pictures of layers with such channels."""
        views = tuple(section.index for section in self.sections)
        data = tuple(section.data for section in self.sections)
        return UnitPictures(tuple(channels), sections=self.sections, views=views, units=data)


def check_units(file: Opened) -> list[Section]:
    """The sections VIEW; FormatError if they are not each there once, in order and behind all others."""
    units = [section for section in file.sections if section.kind == L.VIEW]
    if [unit.index for unit in units] != list(range(file.views)) or list(file.sections[-len(units) :]) != units:
        raise FormatError("views are not each there once, in order and behind all else", where="section VIEW")
    return units


def readable_views(file: Opened, wanted: Sequence[int], *, is_damaged: bool) -> list[int]:
    """Those of the wanted views whose heads are at hand, and where the file `is_damaged` intact.

    Raises:
        FormatError: there is none.
    """
    order, fields = _order(Cursor(file.only(L.UNITS)), file.layer_count), _fields(file)
    size = L.VIEW_HEAD.size + sum(structure.size for _, structure in fields) + len(order) * L.STREAM.size
    units = {section.index: section for section in file.sections if section.kind == L.VIEW}

    def is_readable(view: int) -> bool:
        if view not in units:
            return True  # which reading says
        head = units[view].data[:size]
        is_there = len(head) == size
        return is_there and not (is_damaged and crc32(head[L.VIEW_HEAD.size :]) != L.VIEW_HEAD.unpack_from(head)[0])

    found = [view for view in wanted if is_readable(view)]
    if not found:
        begin = [unit.end - unit.length + size for view, unit in units.items() if view in wanted]
        raise FormatError(f"holds no intact view; the head of the first ends at byte {min(begin)}", where="file")
    return found


def _order(cursor: Cursor, layer_count: int) -> list[tuple[int, int]]:
    """(layer, record) of a view's pictures, as they stand; layers check that they are all of their records."""
    count, _ = cursor.unpack(L.UNITS_FIXED)
    order = [cursor.unpack(L.UNIT_PICTURE) for _ in range(count)]
    cursor.finish()
    cursor.require(len(set(order)) == count, "a picture stands twice")
    cursor.require(all(layer < layer_count for layer, _ in order), f"a layer beyond the {layer_count} that there are")
    return [(layer, record) for layer, record in order]


def _fields(file: Opened) -> list[tuple[int, struct.Struct]]:
    """(layer, structure) of what stands in each head before the lengths of pictures."""
    fields = []
    for index in range(file.layer_count):
        flags = layer_flags(file.only(L.LAYER, index))
        fields += [(index, L.INTRINSICS)] if flags & L.OWN_INTRINSICS else []
        fields += [(index, L.REFERENCE_QUAT)] if flags & L.RELATIVE_ROTATION else []
    return fields


def _head(section: Section, order: Sequence[tuple[int, int]], fields: Sequence[tuple[int, struct.Struct]]) -> _Head:
    cursor = Cursor(section)
    (crc,) = cursor.unpack(L.VIEW_HEAD)
    size = sum(structure.size for _, structure in fields) + len(order) * L.STREAM.size
    own = cursor.take(size)
    cursor.require(crc32(own) == crc, "CRC of the head differs: the bytes were altered")
    found: dict[struct.Struct, dict[int, tuple[float, ...]]] = {L.INTRINSICS: {}, L.REFERENCE_QUAT: {}}
    at = 0
    for index, structure in fields:
        found[structure][index] = structure.unpack_from(own, at)
        at += structure.size
    streams, end = {}, L.VIEW_HEAD.size + size
    for place, (length, picture_crc) in zip(order, L.STREAM.iter_unpack(own[at:]), strict=True):
        streams[place] = StreamRef(end, length, picture_crc)
        end += length
    cursor.require(end == section.length, f"{section.length} bytes, its head and pictures have {end}")
    return _Head(found[L.INTRINSICS], found[L.REFERENCE_QUAT], streams)


def passes(layers: Sequence[CodedLayer]) -> Iterator[tuple[int, PlaneClass, list[int]]]:
    """Layer, class and records of what is coded, in the order in which a picture gets better from pass to pass."""
    for number in PASSES:
        ordered = list(enumerate(layers))[:: -1 if number == BACK_TO_FRONT else 1]
        for (index, layer), plane_class in product(ordered, CODING_ORDER):
            of_class = [n for n, channel in enumerate(layer.records) if channel.plane_class == plane_class]
            coded = [n for i, n in enumerate(of_class) if pass_of(plane_class, i) == number]
            coded = [n for n in coded if layer.records[n].payloads]
            if coded:
                yield index, plane_class, coded


def unit_sections(layers: Sequence[CodedLayer]) -> list[NewSection]:
    """UNIT, and a section VIEW of each view."""
    order = [(index, number) for index, _, records in passes(layers) for number in records]
    listed = b"".join(L.UNIT_PICTURE.pack(index, number) for index, number in order)
    sections = [NewSection(L.UNITS, 0, L.UNITS_FIXED.pack(len(order), 0) + listed, UNITS_MINOR)]
    fields = [view_fields(layer, index) for index, layer in enumerate(layers)]
    records = [layer.records for layer in layers]
    for view in range(len(layers[0].cameras)):
        payloads = [records[index][number].payloads[view] for index, number in order]
        own = b"".join(part for of_layer in fields for part in of_layer[view])
        own += b"".join(L.STREAM.pack(len(payload), crc32(payload)) for payload in payloads)
        data = b"".join((L.VIEW_HEAD.pack(crc32(own)), own, *payloads))
        sections.append(NewSection(L.VIEW, view, data, UNITS_MINOR))
    return sections
