"""A parsed file, and what it is a file of: the body, of one kind for each mode.

A body reads itself from the file's sections and says what is in it. It is the part of a mode that stands behind the
trust boundary; `codec/modes/` has the other part, which encodes and decodes. `bodies.py` lists them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, InputError
from ..gaussian.notes import Notes
from ..scene.cameras import Camera
from . import layout as L
from .records import Limits, PlanePictures
from .sections import Cursor, Section, only, require

Item = TypeVar("Item")


@dataclass(frozen=True)
class Opened:
    """What a body is read from.

    Attributes:
        scene: the section SCEN, for messages.
        sections: all sections that the reader knows, their CRCs checked but those of planes.
        views, layer_count: as SCEN has them.
        wanted: which views are read, where the body's kind `is_divisible`.
        origin: (3,) float64.
        limits: what to accept.
    """

    scene: Section
    sections: Sequence[Section]
    views: int
    wanted: tuple[int, ...]
    layer_count: int
    origin: NDArray
    limits: Limits

    def only(self, kind: bytes, index: int = 0) -> Section:
        """The one section of a type and index; FormatError if it is missing or there twice."""
        return only(self.sections, kind, index)

    def has(self, kind: bytes) -> bool:
        """Whether there is a section of the type."""
        return any(section.kind == kind for section in self.sections)

    def check_counts(self, has_layers: bool = True) -> None:
        """FormatError for numbers of views or layers beyond what a file with cameras may have."""
        most = self.limits.max_views
        require(1 <= self.views <= most, self.scene, f"{self.views} views, accepted are 1 to {most}")
        least, most = (1, self.limits.max_layers) if has_layers else (0, 0)
        accepted = f"{self.layer_count} layers, accepted are {least} to {most}"
        require(least <= self.layer_count <= most, self.scene, accepted)

    @cached_property
    def poses(self) -> tuple[tuple[NDArray, NDArray], ...]:
        """K (3, 3) and c2w (4, 4) float64 of the wanted views."""
        section = self.only(L.CAMERAS)
        whole = Cursor(section)
        rows = whole.take(self.views * L.CAMERA.size)
        whole.finish()
        poses = []
        for view in self.wanted:
            numbers = L.CAMERA.unpack_from(rows, view * L.CAMERA.size)
            c2w = np.eye(4)
            c2w[:3] = np.reshape(numbers[5:], (3, 4))
            K = calibration(*numbers[:5])
            camera_in(section, view, K, c2w, 1, 1)
            poses.append((K, c2w))
        return tuple(poses)

    def cameras(self, height: int, width: int) -> tuple[Camera, ...]:
        """The cameras of pictures of that size."""
        return tuple(Camera(K, c2w, width, height) for K, c2w in self.poses)

    @cached_property
    def parameter_sets(self) -> Mapping[int, bytes]:
        """HEVC parameter sets by index."""
        found = [section for section in self.sections if section.kind == L.PARAMETER_SETS]
        for section in found:
            if len(section.data) > L.MAX_PARAMETER_SET_BYTES:
                size = f"{len(section.data)} bytes of parameter sets, expected at most {L.MAX_PARAMETER_SET_BYTES}"
                raise FormatError(size, where=section.label)
        return {section.index: bytes(section.data) for section in found}

    def require_parameter_set(self, number: int, where: str) -> None:
        """FormatError unless the parameter set is there."""
        if number not in self.parameter_sets:
            raise FormatError(f"parameter set {number} is missing", where=where)


@dataclass(frozen=True)
class Piece:
    """Bytes of a body that are no pictures of planes.

    Attributes:
        label: what they are, as `bytes_by_class` says.
        view: whose they are; None for those of no view.
    """

    label: str
    view: int | None
    bytes: int


@dataclass(frozen=True)
class Description:
    """What a body says of itself; JSON-ready but for `pieces`. `inspection.inspect_bytes` says what the names mean."""

    gaussians: int | None = None
    sh_degree: int | None = None
    k: int | None = None
    network: dict[str, Any] | None = None
    photos: dict[str, Any] | None = None
    layers: tuple[dict[str, Any], ...] = ()
    left_out: tuple[dict[str, Any], ...] = ()
    pieces: tuple[Piece, ...] = ()
    tiers: tuple[int, ...] = ()
    viewpoints: tuple[Camera, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Body(ABC):
    """What a file holds besides its notes.

    Attributes:
        mode: the name of the mode, as users say.
        kinds: types of sections that a file of the mode may have, beside SCEN and notes.
        signs: those of them that no other mode has.
        is_divisible: views can be decoded one without another, to the same bits.
        cameras: one per view; none where Gaussians belong to no pixels.
        pictures: of planes, where the mode has any.
    """

    mode: ClassVar[str]
    kinds: ClassVar[frozenset[bytes]]
    signs: ClassVar[frozenset[bytes]]
    is_divisible: ClassVar[bool] = False

    cameras: tuple[Camera, ...] = ()
    pictures: PlanePictures = field(default_factory=PlanePictures)

    @classmethod
    def is_told_by(cls, kinds: Collection[bytes]) -> bool:
        """Whether a file with such sections is of this mode, unless one listed before it is."""
        return not cls.signs.isdisjoint(kinds)

    @classmethod
    @abstractmethod
    def read(cls, file: Opened) -> Body:
        """Parse and check the file's sections; FormatError where they are damaged or beyond the limits."""

    @abstractmethod
    def describe(self) -> Description:
        """What `info` says of it."""

    def select(self, views: Sequence[int]) -> Body:
        """The body as if there were these views alone; only of a kind that `is_divisible`."""
        raise NotImplementedError

    def picture_name(self, layer: int, channel: int, view: int) -> str:
        """One of `pictures` for messages, such as `layer 0 color2 view 1`."""
        return f"layer {layer} {self.pictures.channels[layer][channel].name} view {self.pictures.number(view)}"


@dataclass(frozen=True)
class Container:
    """A parsed file.

    Attributes:
        version: major and minor.
        profile, qp: profile and Q_g, for information.
        origin: (3,) float64.
        body: what it is a file of.
        parameter_sets: HEVC parameter sets by index.
        notes: what the scene's maker says about it, and how it was refined.
        total_bytes: size of the whole file, of which `read_container` may have been given a prefix.
        views: which of the file's views it holds, in its order; none where Gaussians belong to no pixels.
        absent: views that it lacks as their bytes are not at hand, or damaged.
    """

    version: tuple[int, int]
    profile: str
    qp: float
    origin: NDArray
    body: Body
    parameter_sets: Mapping[int, bytes]
    notes: Notes
    total_bytes: int
    views: tuple[int, ...]
    absent: tuple[int, ...] = ()

    @property
    def mode(self) -> str:
        """The name of the body's mode."""
        return self.body.mode

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """One per view."""
        return self.body.cameras

    @property
    def pictures(self) -> PlanePictures:
        """Pictures of planes."""
        return self.body.pictures


def picked(items: Sequence[Item], views: Sequence[int]) -> tuple[Item, ...]:
    """Those of the views."""
    return tuple(items[view] for view in views)


def calibration(fx: float, fy: float, cx: float, cy: float, skew: float) -> NDArray:
    """K (3, 3) float64 of the numbers that files have, in pixels."""
    return np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])


def camera_in(section: Section, view: int, K: NDArray, c2w: NDArray, width: int, height: int) -> Camera:
    """The camera of K (3, 3) and c2w (4, 4) float64; FormatError naming section and view if they make none."""
    try:
        return Camera(K, c2w, width, height)
    except InputError as error:
        raise FormatError(error.message, where=f"{section.label}: view {view}: {error.where}") from None


def check_totals(gaussians: int, memory: int, limits: Limits, where: str) -> None:
    """FormatError where Gaussians, or the bytes that decoding them takes, are beyond the limits."""
    if gaussians > limits.max_pixels:
        raise FormatError(f"{gaussians} Gaussians, the limit is {limits.max_pixels} (--max-pixels)", where=where)
    if memory > limits.max_memory_bytes:
        found = f"{memory} bytes to decode, the limit is {limits.max_memory_bytes} (--max-memory)"
        raise FormatError(found, where=where)
