"""What a parsed file is: the records that `reader` fills, `bounds` checks and all code behind the trust boundary uses;
and `Limits`, what it may ask for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from zlib import crc32

from numpy.typing import NDArray

from ..errors import FormatError
from ..gaussian.notes import NO_NOTES, Notes
from ..gaussian.planes import PlaneClass
from ..scene.cameras import Camera
from .sections import Section


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
class NetworkRef:
    """Which network a file needs, and the depth range that it is run with.

    Attributes:
        name: for messages, and to find the file.
        sha256: of the ONNX file, hexadecimal; the network that is run must have it.
        near, far: depths in scene units.
    """

    name: str
    sha256: str
    near: float
    far: float


@dataclass(frozen=True)
class PhotoHeader:
    """Photos of a file: their size, and where their pictures lie in `data`."""

    height: int
    width: int
    qp: int
    parameter_set: int
    streams: tuple[StreamRef, ...]
    data: memoryview

    def payload(self, view: int) -> memoryview:
        """One photo's slice; FormatError if its CRC differs."""
        stream = self.streams[view]
        data = self.data[stream.offset : stream.offset + stream.length]
        if crc32(data) != stream.crc:
            raise FormatError("CRC differs: the bytes were altered", where=f"photo {view}")
        return data


def exact_plane_count(degree: int) -> int:
    """Planes of a view: 12 of geometry, and all SH coefficients."""
    return 12 + 3 * (degree + 1) ** 2


@dataclass(frozen=True)
class ExactLayer:
    """A layer of exact planes of a file: its grid, and where its planes lie in `data`, views outermost."""

    cameras: tuple[Camera, ...]
    degree: int
    depth_limits: tuple[float, float]
    sha256: bytes
    streams: tuple[StreamRef, ...]
    data: memoryview

    @property
    def height(self) -> int:
        """Rows of the grid."""
        return self.cameras[0].height

    @property
    def width(self) -> int:
        """Columns of the grid."""
        return self.cameras[0].width

    @property
    def planes(self) -> int:
        """Planes of a view."""
        return exact_plane_count(self.degree)

    @property
    def gaussians(self) -> int:
        """Gaussians of the layer."""
        return len(self.cameras) * self.height * self.width

    def payload(self, number: int) -> memoryview:
        """One plane's bytes; FormatError if its CRC differs."""
        stream = self.streams[number]
        data = self.data[stream.offset : stream.offset + stream.length]
        if crc32(data) != stream.crc:
            raise FormatError("CRC differs: the bytes were altered", where=f"exact plane {number}")
        return data


@dataclass(frozen=True)
class LayerHeader:
    """A layer's metadata; see `LayerPlan` for what the maps mean.

    Attributes:
        cameras: one per view, with the layer's own grid and intrinsics.
        reference_quats: (V, 4) float32 or None.
        scale_mix: ((3, 3), (3,)) float32 or None.
        basis: (d, k) float16, or None where colour planes are degree-0 coefficients.
        parameter_set: index of its pictures' parameter sets.
    """

    height: int
    width: int
    degree: int
    source_degree: int
    depth_limits: tuple[float, float]
    energy_lost: float
    condition: float
    inverse_depth: bool
    cameras: tuple[Camera, ...]
    reference_quats: NDArray | None
    scale_mix: tuple[NDArray, NDArray] | None
    basis: NDArray | None
    parameter_set: int
    channels: tuple[ChannelRecord, ...]

    @property
    def gaussians(self) -> int:
        """Gaussians of the layer."""
        return len(self.cameras) * self.height * self.width


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


@dataclass(frozen=True)
class Container:
    """A parsed file.

    Attributes:
        cameras: one per view.
        origin: (3,) float64.
        layers: metadata, the network's per-pixel layer first.
        parameter_sets: HEVC parameter sets by index.
        streams: the pictures of a class by (class, layer): its sections joined, as far as the bytes at hand reach.
        plane_sections: the sections that hold pictures of planes, in the file's order.
        network: the network that the receiver runs on `photos`; both or neither.
        exact: layers of exact planes, in place of `layers`.
        free: Gaussians that belong to no pixels, in place of `layers` and `cameras`.
        notes: what the scene's maker says about it, and how it was refined.
        total_bytes: size of the whole file, of which `read_container` may have been given a prefix.
    """

    version: tuple[int, int]
    profile: str
    qp: float
    origin: NDArray
    cameras: tuple[Camera, ...]
    layers: tuple[LayerHeader, ...]
    parameter_sets: Mapping[int, bytes]
    streams: Mapping[tuple[PlaneClass, int], memoryview]
    plane_sections: tuple[Section, ...]
    total_bytes: int
    network: NetworkRef | None = None
    photos: PhotoHeader | None = None
    exact: tuple[ExactLayer, ...] = ()
    free: FreeScene | None = None
    notes: Notes = NO_NOTES

    @property
    def mode(self) -> str:
        """`gaussians`; `photos`, which a network turns into them; `hybrid`, whose planes correct what it gives;
        `lossless`; `free`, whose Gaussians belong to no pixels.
        """
        if self.free is not None:
            return "free"
        if self.exact:
            return "lossless"
        return "gaussians" if self.photos is None else "hybrid" if self.layers else "photos"

    @property
    def channels(self) -> tuple[tuple[ChannelRecord, ...], ...]:
        """The channel records of each layer; those of mode free as one."""
        if self.free is not None:
            return (tuple(channel.record for channel in self.free.channels),)
        return tuple(layer.channels for layer in self.layers)

    def holds(self, layer: int, channel: ChannelRecord, view: int) -> bool:
        """Whether the bytes at hand reach to the end of one picture; always for a whole file."""
        stream = channel.streams[view]
        return stream.offset + stream.length <= len(self.streams[channel.plane_class, layer])

    def payload(self, layer: int, channel: ChannelRecord, view: int) -> memoryview:
        """One picture's slice, its CRC checked.

        Raises:
            FormatError: the bytes are not those that were written.
        """
        stream = channel.streams[view]
        data = self.streams[channel.plane_class, layer][stream.offset : stream.offset + stream.length]
        if crc32(data) != stream.crc:
            raise FormatError("CRC differs: the bytes were altered", where=f"plane {channel.name}, view {view}")
        return data
