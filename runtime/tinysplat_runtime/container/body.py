"""A parsed file, and what it is a file of: the body, of one kind for each mode.

A body reads itself from the file's sections and says what is in it. It is the part of a mode that stands behind the
trust boundary; `modes/` has the other part, which encodes and decodes. `bodies.py` lists them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from numpy.typing import NDArray

from ..errors import FormatError
from ..gaussian.notes import Notes
from ..gaussian.planes import PlaneClass
from ..scene.cameras import Camera
from ..system.jsonfields import JsonObject
from . import layout as L
from .cameras import cameras_of, layer_cameras, read_numbers
from .limits import Limits
from .records import ChannelRecord
from .sections import Cursor, Section, only, require
from .table import Table


@dataclass(frozen=True)
class Opened:
    """What a body is read from.

    Attributes:
        scene: the section SCEN, for messages.
        sections: all sections that the reader knows, their CRCs checked but that of DATA.
        views, layer_count: as SCEN has them: cameras, and layers or tiers.
        table: the pictures of the views that are read.
        origin: (3,) float64.
        limits: what to accept.
    """

    scene: Section
    sections: Sequence[Section]
    views: int
    layer_count: int
    table: Table
    origin: NDArray
    limits: Limits

    def only(self, kind: bytes, index: int = 0) -> Section:
        """The one section of a type and index; FormatError if it is missing or there twice."""
        return only(self.sections, kind, index)

    def check_counts(self, has_layers: bool = True) -> None:
        """FormatError for numbers of views or layers beyond what a file with cameras may have."""
        most = self.limits.max_views
        require(1 <= self.views <= L.MAX_VIEWS, self.scene, f"{self.views} views, accepted are 1 to {L.MAX_VIEWS}")
        wanted = len(self.table.views)
        require(wanted <= most, self.scene, f"{wanted} views, accepted are 1 to {most}")
        least, most = (1, self.limits.max_layers) if has_layers else (0, 0)
        accepted = f"{self.layer_count} layers, accepted are {least} to {most}"
        require(least <= self.layer_count <= most, self.scene, accepted)
        pictures = f"pictures of {self.table.count} views of {self.views}"
        require(self.table.count == self.views, self.scene, pictures)

    def check_rows(self, classes: Sequence[PlaneClass]) -> None:
        """FormatError for rows of the table of other classes, or of layers that there are not."""
        for layer, record in self.table.rows:
            place = f"a row {record.name} of layer {layer}"
            require(record.plane_class in classes, self.only(L.PICTURES), f"{place} in a file of another mode")
            require(layer < max(self.layer_count, 1), self.only(L.PICTURES), f"{place}, there are {self.layer_count}")

    @cached_property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras of the views that are read."""
        return self.cameras_of(self.table.views)

    def cameras_of(self, views: Sequence[int]) -> tuple[Camera, ...]:
        """Some cameras of the section CAMS, which a file without any does not have."""
        if not self.views:
            return ()
        section = self.only(L.CAMERAS)
        return cameras_of(section, read_numbers(section, self.views), views)

    def layer_cameras(self, cursor: Cursor, height: int, width: int, *, has_own: bool) -> tuple[Camera, ...]:
        """The cameras of a layer's grid, whose own intrinsics follow where it `has_own`."""
        own = self.views if has_own else 0
        return layer_cameras(cursor, self.cameras, self.table.views, height, width, own=own)

    def check_sizes(self, height: int, width: int, where: str) -> None:
        """FormatError unless the cameras' pictures have that size."""
        for camera in self.cameras:
            if (camera.height, camera.width) != (height, width):
                found = f"{width}x{height}, its cameras have {camera.width}x{camera.height}"
                raise FormatError(found, where=where)

    @cached_property
    def parameter_sets(self) -> Mapping[int, bytes]:
        """HEVC parameter sets by index."""
        found = [section for section in self.sections if section.kind == L.PARAMETER_SETS]
        for section in found:
            if len(section.data) > L.MAX_PARAMETER_SET_BYTES:
                size = f"{len(section.data)} bytes of parameter sets, expected at most {L.MAX_PARAMETER_SET_BYTES}"
                raise FormatError(size, where=section.label)
        return {section.index: bytes(section.data) for section in found}

    def require_parameter_set(self, number: int, records: Sequence[ChannelRecord], where: str) -> None:
        """FormatError unless the parameter set is there, or none of the channels has pictures."""
        if number not in self.parameter_sets and any(record.pictures for record in records):
            raise FormatError(f"parameter set {number} is missing", where=where)


@dataclass(frozen=True)
class Description:
    """What a body says of itself; JSON-ready. `inspection.inspect_bytes` says what the names mean."""

    gaussians: int | None = None
    sh_degree: int | None = None
    k: int | None = None
    network: JsonObject | None = None
    photos: JsonObject | None = None
    layers: tuple[JsonObject, ...] = ()
    left_out: tuple[JsonObject, ...] = ()
    tiers: tuple[int, ...] = ()
    viewpoints: tuple[Camera, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Body(ABC):
    """What a file holds besides its notes and pictures.

    Attributes:
        mode: the name of the mode, as users say.
        sign: the type of section that tells the mode.
        kinds: types of sections that a file of the mode may have, beside those of all.
        is_divisible: views can be decoded one without another, to the same bits.
        cameras: one per view; none where Gaussians belong to no pixels.
    """

    mode: ClassVar[str]
    sign: ClassVar[bytes]
    kinds: ClassVar[frozenset[bytes]]
    is_divisible: ClassVar[bool] = False

    cameras: tuple[Camera, ...] = ()

    @classmethod
    @abstractmethod
    def read(cls, file: Opened) -> Body:
        """Parse and check the file's sections and rows; FormatError where they are damaged or beyond the limits."""

    @abstractmethod
    def describe(self) -> Description:
        """What `info` says of it."""

    @staticmethod
    def step(layer: int, record: ChannelRecord, number: int) -> Hashable:
        """What part of the picture a row is: a prefix is worth showing where one ends (`Table.prefixes`)."""
        return None

    def picture_name(self, layer: int, channel: ChannelRecord, view: int) -> str:
        """A picture for messages, such as `layer 0 color2 view 1`."""
        return f"layer {layer} {channel.name} view {view}"


@dataclass(frozen=True)
class Container:
    """A parsed file.

    Attributes:
        version: major and minor.
        profile, qp: profile and Q_g, for information.
        origin: (3,) float64.
        body: what it is a file of.
        table: its pictures.
        parameter_sets: HEVC parameter sets by index.
        notes: what the scene's maker says about it, and how it was refined.
        total_bytes: size of the whole file, of which `read_container` may have been given a prefix.
        chosen: views that were asked for, where the mode's need one another and all have to be decoded.
    """

    version: tuple[int, int]
    profile: str
    qp: float
    origin: NDArray
    body: Body
    table: Table
    parameter_sets: Mapping[int, bytes]
    notes: Notes
    total_bytes: int
    chosen: Sequence[int] | None = None

    @property
    def lost(self) -> list[str]:
        """Names of the pictures that are cut off or damaged."""
        table = self.table
        return [
            self.body.picture_name(layer, record, table.views[view])
            for layer in sorted(table.layers)
            for record in table.layers[layer]
            for view in range(len(record.pictures))
            if record.lacks(view)
        ]

    @property
    def mode(self) -> str:
        """The name of the body's mode."""
        return self.body.mode

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """One per view."""
        return self.body.cameras


def check_totals(gaussians: int, memory: int, limits: Limits, where: str) -> None:
    """FormatError where Gaussians, or the bytes that decoding them takes, are beyond the limits."""
    if gaussians > limits.max_pixels:
        raise FormatError(f"{gaussians} Gaussians, the limit is {limits.max_pixels} (--max-pixels)", where=where)
    if memory > limits.max_memory_bytes:
        found = f"{memory} bytes to decode, the limit is {limits.max_memory_bytes} (--max-memory)"
        raise FormatError(found, where=where)
