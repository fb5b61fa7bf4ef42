"""What bodies are made of: references to coded pictures and channels, and `Limits`, what a file may ask for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

from numpy.typing import NDArray

from ..errors import FormatError
from ..gaussian.planes import PlaneClass
from .layout import MAX_VIEWS, PART, STREAM
from .sections import Cursor, Section


@dataclass(frozen=True)
class Limits:
    """What a reader accepts before it takes memory.

    Attributes:
        max_pixels: Gaussians over all views and layers.
        max_memory_bytes: bytes that decoding takes, as `bounds.decoding_bytes` counts them.
        max_views: views.
        max_layers: layers.
    """

    max_pixels: int = 1 << 26
    max_memory_bytes: int = 8 << 30
    max_views: int = MAX_VIEWS
    max_layers: int = 16

    @classmethod
    def for_describing(cls, max_pixels: int | None = None, max_memory_bytes: int | None = None) -> Limits:
        """As many Gaussians and as much memory as any file states unless they are given: describing takes neither."""
        return cls(max_pixels or 1 << 62, max_memory_bytes or 1 << 62)


@dataclass(frozen=True)
class StreamRef:
    """One coded picture: `offset` and `length` in its class's section, and its CRC-32."""

    offset: int
    length: int
    crc: int

    def checked(self, data: memoryview, where: str) -> memoryview:
        """The picture's slice of `data`; FormatError with `where` if its CRC differs."""
        found = data[self.offset : self.offset + self.length]
        if crc32(found) != self.crc:
            raise FormatError("CRC differs: the bytes were altered", where=where)
        return found


@dataclass(frozen=True)
class ChannelRecord:
    """One channel as stored.

    Attributes:
        plane_class, target: which channel of which class the values add to.
        qp: QP of its pictures.
        scale, offset: value = offset + code · scale; a constant channel is `offset` alone.
        streams: one per view; empty for a constant channel.
    """

    plane_class: PlaneClass
    target: int
    qp: int
    scale: float
    offset: float
    streams: tuple[StreamRef, ...] = ()

    @property
    def key(self) -> tuple[PlaneClass, int]:
        """Its class and target."""
        return self.plane_class, self.target

    @property
    def name(self) -> str:
        """For messages and reports."""
        return f"{self.plane_class.label}{self.target}"


@dataclass(frozen=True)
class PlanePictures:
    """The pictures of planes that a file holds.

    Attributes:
        channels: the channel records of each layer; in mode free, of each tier.
        data: the pictures of a class by (class, layer): its sections joined, as far as the bytes at hand reach.
        sections: the sections that hold them, in the file's order.
        views: the numbers that views have in the file, where they are not those that they have here.
    """

    channels: tuple[tuple[ChannelRecord, ...], ...] = ()
    data: Mapping[tuple[PlaneClass, int], memoryview] = field(default_factory=dict)
    sections: tuple[Section, ...] = ()
    views: tuple[int, ...] = ()

    def number(self, view: int) -> int:
        """The number that a view has in the file, for messages."""
        return self.views[view] if self.views else view

    def source(self, layer: int, channel: ChannelRecord, view: int) -> memoryview:
        """The bytes that a picture's offset counts in."""
        return self.data[channel.plane_class, layer]

    def holds(self, layer: int, channel: ChannelRecord, view: int) -> bool:
        """Whether the bytes at hand reach to the end of one picture; always for a whole file."""
        stream = channel.streams[view]
        return stream.offset + stream.length <= len(self.source(layer, channel, view))

    def payload(self, layer: int, channel: ChannelRecord, view: int) -> memoryview:
        """One picture's slice, its CRC checked.

        Raises:
            FormatError: the bytes are not those that were written.
        """
        stream = channel.streams[view]
        return stream.checked(self.source(layer, channel, view), f"plane {channel.name}, view {self.number(view)}")

    def first_end(self, channel: ChannelRecord) -> int:
        """Bytes of the smallest prefix of the file that holds the first picture of a channel of layer 0."""
        kind = channel.plane_class.facts.section
        section = next(s for s in self.sections if (s.kind, s.index) == (kind, 0))
        return section.end - section.length + channel.streams[0].length

    def prefixes(self) -> list[dict[str, Any]]:
        """Useful numbers for `--max-bytes`: where a pass over a layer ends, and what it adds to those before it.

        Between a pass's sections a prefix decodes as well, but can show less than it does without the first of them.
        """
        class_of = {plane_class.facts.section: plane_class for plane_class in PlaneClass}
        counts: dict[tuple[int, PlaneClass], int] = {}
        prefixes: list[dict[str, Any]] = []
        ending: tuple[int, int] | None = None
        for section in self.sections:
            layer, plane_class = section.index % PART, class_of[section.kind]
            records = [c for c in self.channels[layer] if c.plane_class == plane_class and c.streams]
            first, left = counts.get((layer, plane_class), 0), section.length
            last = first
            while last < len(records) and left > 0:
                left -= sum(stream.length for stream in records[last].streams)
                last += 1
            counts[layer, plane_class] = last
            names, of_pass = [c.name for c in records[first:last]], (layer, pass_of(plane_class, first))
            if of_pass == ending:
                prefixes[-1]["adds"] += names
                prefixes[-1]["bytes"] = section.end
            else:
                prefixes.append({"bytes": section.end, "layer": layer, "adds": names})
            ending = of_pass
        return prefixes


@dataclass(frozen=True)
class UnitPictures(PlanePictures):
    """The pictures of a file whose views are units.

    Attributes:
        units: by view, the bytes of its section VIEW that are at hand; offsets count in them.
    """

    units: tuple[memoryview, ...] = ()

    def source(self, layer: int, channel: ChannelRecord, view: int) -> memoryview:
        """The bytes of the view."""
        return self.units[view]

    def first_end(self, channel: ChannelRecord) -> int:
        """Bytes of the smallest prefix of the file that holds the first picture of a channel of layer 0."""
        section, stream = self.sections[0], channel.streams[0]
        return section.end - section.length + stream.offset + stream.length

    def prefixes(self) -> list[dict[str, Any]]:
        """Where each view ends."""
        return [{"bytes": section.end, "views": view + 1} for view, section in enumerate(self.sections)]


def pass_of(plane_class: PlaneClass, number: int) -> int:
    """The pass that the class's record `number` belongs to; never falls from record to record."""
    facts = plane_class.facts
    return facts.passes[0] if number < facts.base else facts.passes[1]


def read_streams(cursor: Cursor, count: int, data: memoryview) -> tuple[StreamRef, ...]:
    """The table at a section's end: `count` lengths, which add up to that of `data`, with CRCs."""
    streams, end = [], 0
    for _ in range(count):
        length, crc = cursor.unpack(STREAM)
        streams.append(StreamRef(end, length, crc))
        end += length
    cursor.finish()
    cursor.require(end == len(data), f"{len(data)} bytes behind it, {end} announced")
    return tuple(streams)


@dataclass(frozen=True)
class PointGrid:
    """Where positions can lie.

    Attributes:
        centre, radius: coordinates within `radius` of the centre are taken as they are, those beyond as logarithms.
        cell: side of a cell of the contracted space, whose unit is the radius.
        low: (3,) contracted coordinates of cell 0's middle.
        levels: cells of each level of the octree from its root.
        leaves, escapes: see `codec.free.octree`.
        streams: the octree's bytes.
    """

    centre: NDArray
    radius: float
    cell: float
    low: NDArray
    levels: tuple[int, ...]
    leaves: int
    escapes: int
    streams: tuple[bytes | memoryview, ...]


@dataclass(frozen=True)
class WeightClasses:
    """An order of Gaussians by what they weigh, in classes.

    Attributes:
        first: what is subtracted from half the count of thresholds reached.
        gains: by class, what a channel's decoded number is multiplied by.
    """

    first: int
    gains: tuple[float, ...]


@dataclass(frozen=True)
class FreeChannel:
    """A channel: `record` as in layers with one picture, and what is added behind the gain."""

    record: ChannelRecord
    centre: float


@dataclass(frozen=True)
class FreeTier:
    """Some of the Gaussians of a file of mode free.

    Attributes:
        count: how many.
        grid: where they lie; its streams are none where a prefix does not hold them all.
        channels: all that there are, in the order of records.
        growth: what is added to logarithms of scales in front of it where the tier is absent.
    """

    count: int
    grid: PointGrid
    channels: tuple[FreeChannel, ...]
    growth: float = 0.0

    def channel(self, plane_class: PlaneClass, target: int) -> FreeChannel:
        """One of the channels, each of which there is."""
        return next(c for c in self.channels if c.record.key == (plane_class, target))


@dataclass(frozen=True)
class FreeScene:
    """The metadata of a file of mode free.

    Attributes:
        size_middle: logarithm of the size whose steps are those of the logarithm.
        thresholds: of each determinant, rising.
        orders: by one, two and all three determinants.
        mean: (d,) float32, d = 3(degree + 1)².
        basis: (d, k) float16.
        tiers: from those that pictures need most, at least one; their grids have centre, radius and low in common.
    """

    degree: int
    size_middle: float
    thresholds: tuple[NDArray, ...]
    orders: tuple[WeightClasses, ...]
    mean: NDArray
    basis: NDArray
    tiers: tuple[FreeTier, ...]

    @property
    def count(self) -> int:
        """Gaussians of all tiers."""
        return sum(tier.count for tier in self.tiers)
