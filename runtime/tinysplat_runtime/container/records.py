"""What bodies are made of: references to coded pictures and channels, and `Limits`, what a file may ask for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from zlib import crc32

from numpy.typing import NDArray

from ..errors import FormatError
from ..gaussian.planes import PlaneClass
from .layout import STREAM
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
    max_views: int = 256
    max_layers: int = 16


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
    def name(self) -> str:
        """For messages and reports."""
        return f"{self.plane_class.label}{self.target}"


@dataclass(frozen=True)
class Pictures:
    """The pictures of planes that a file holds.

    Attributes:
        channels: the channel records of each layer; those of mode free as one layer's.
        data: the pictures of a class by (class, layer): its sections joined, as far as the bytes at hand reach.
        sections: the sections that hold them, in the file's order.
    """

    channels: tuple[tuple[ChannelRecord, ...], ...] = ()
    data: Mapping[tuple[PlaneClass, int], memoryview] = field(default_factory=dict)
    sections: tuple[Section, ...] = ()

    def holds(self, layer: int, channel: ChannelRecord, view: int) -> bool:
        """Whether the bytes at hand reach to the end of one picture; always for a whole file."""
        stream = channel.streams[view]
        return stream.offset + stream.length <= len(self.data[channel.plane_class, layer])

    def payload(self, layer: int, channel: ChannelRecord, view: int) -> memoryview:
        """One picture's slice, its CRC checked.

        Raises:
            FormatError: the bytes are not those that were written.
        """
        stream = channel.streams[view]
        return stream.checked(self.data[channel.plane_class, layer], f"plane {channel.name}, view {view}")


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
class FreeScene:
    """The metadata of a file of mode free.

    Attributes:
        count: Gaussians.
        size_middle: logarithm of the size whose steps are those of the logarithm.
        thresholds: of each determinant, rising.
        orders: by one, two and all three determinants.
        mean: (d,) float32, d = 3(degree + 1)².
        basis: (d, k) float16.
    """

    count: int
    degree: int
    grid: PointGrid
    size_middle: float
    thresholds: tuple[NDArray, ...]
    orders: tuple[WeightClasses, ...]
    mean: NDArray
    basis: NDArray
    channels: tuple[FreeChannel, ...]

    def channel(self, plane_class: PlaneClass, target: int) -> FreeChannel:
        """One of the channels, each of which there is."""
        wanted = plane_class, target
        return next(c for c in self.channels if (c.record.plane_class, c.record.target) == wanted)
