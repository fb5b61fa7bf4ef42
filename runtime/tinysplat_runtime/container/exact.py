"""Body `Exact`, of mode lossless: layers of planes as float16, bit for bit. Layout: docs/FORMAT.md, section EXAC."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar
from zlib import crc32

from numpy.typing import NDArray

from ..gaussian.planes import MAX_DECODED
from ..gaussian.sh import MAX_SH_DEGREE
from ..scene.cameras import Camera
from . import layout as L
from .body import Body, Description, Opened, Piece, calibration, camera_in, check_totals
from .layers import PixelGrid, intrinsics
from .records import StreamRef, read_streams
from .sections import Cursor, NewSection

EXACT = b"EXAC"
EXACT_PLANES = b"EXAP"

EXACT_FIXED = struct.Struct("<IIB3sff32s")
"""height, width, SH degree, reserved (0), least z, largest z, SHA-256 of the planes; then per view INTRINSICS, and per
view and plane a STREAM."""


@dataclass(frozen=True)
class ExactLayer(PixelGrid):
    """A layer of exact planes of a file: its grid, and where its planes lie in `data`, views outermost."""

    cameras: tuple[Camera, ...]
    degree: int
    depth_limits: tuple[float, float]
    sha256: bytes
    streams: tuple[StreamRef, ...]
    data: memoryview

    @property
    def planes(self) -> int:
        """Planes of a view: 12 of geometry, and all SH coefficients."""
        return 12 + 3 * (self.degree + 1) ** 2

    def payload(self, number: int) -> memoryview:
        """One plane's bytes; FormatError if its CRC differs."""
        return self.streams[number].checked(self.data, f"exact plane {number}")


@dataclass(frozen=True)
class CodedExact:
    """A layer of exact planes ready for the file: a payload per view and plane, views outermost."""

    cameras: tuple[Camera, ...]
    degree: int
    depth_limits: tuple[float, float]
    sha256: bytes
    payloads: tuple[bytes, ...]


@dataclass(frozen=True, kw_only=True)
class Exact(Body):
    """Layers of exact planes."""

    mode: ClassVar[str] = "lossless"
    kinds: ClassVar[frozenset[bytes]] = frozenset({L.CAMERAS, EXACT, EXACT_PLANES})
    signs: ClassVar[frozenset[bytes]] = frozenset({EXACT, EXACT_PLANES})

    layers: tuple[ExactLayer, ...]

    @classmethod
    def read(cls, file: Opened) -> Exact:
        """Parse and check the sections EXAC and EXAP."""
        file.check_counts()
        poses = [c2w for _, c2w in file.poses]
        layers: list[ExactLayer] = []
        pixels = memory = 0
        for index in range(file.layer_count):
            planes = file.only(EXACT_PLANES, index)
            layer = _read_exact(Cursor(file.only(EXACT, index)), poses, planes.data)
            pixels += layer.gaussians
            memory += 12 * layer.gaussians * layer.planes  # float16, float64 and float32 at a time
            check_totals(pixels, memory, file.limits, f"section EXAC[{index}]")
            layers.append(layer)
        return cls(cameras=file.cameras(layers[0].height, layers[0].width), layers=tuple(layers))

    def describe(self) -> Description:
        """Gaussians, and bytes by view."""
        pieces = [
            Piece("exact", number // layer.planes, stream.length)
            for layer in self.layers
            for number, stream in enumerate(layer.streams)
        ]
        gaussians = sum(layer.gaussians for layer in self.layers)
        return Description(gaussians=gaussians, sh_degree=self.layers[0].degree, pieces=tuple(pieces))


def exact_sections(layer: CodedExact, index: int) -> list[NewSection]:
    """The sections of a layer of exact planes."""
    first = layer.cameras[0]
    fixed = EXACT_FIXED.pack(first.height, first.width, layer.degree, b"", *layer.depth_limits, layer.sha256)
    own = b"".join(L.INTRINSICS.pack(*intrinsics(camera.K)) for camera in layer.cameras)
    table = b"".join(L.STREAM.pack(len(payload), crc32(payload)) for payload in layer.payloads)
    return [NewSection(EXACT, index, fixed + own + table), NewSection(EXACT_PLANES, index, b"".join(layer.payloads))]


def _read_exact(cursor: Cursor, poses: Sequence[NDArray], data: memoryview) -> ExactLayer:
    """Parse and check an EXAC section; `data` are the bytes of its planes, `poses` c2w per view."""
    height, width, degree, _, z_min, z_max, digest = cursor.unpack(EXACT_FIXED)
    cursor.require(
        1 <= height <= L.MAX_SIDE and 1 <= width <= L.MAX_SIDE, f"grid {width}x{height}, sides 1 to {L.MAX_SIDE}"
    )
    cursor.require(degree <= MAX_SH_DEGREE, f"SH degree {degree}, accepted are 0 to {MAX_SH_DEGREE}")
    depths = f"depth limits {z_min:g} to {z_max:g}, expected positive and ordered"
    cursor.require(1 / MAX_DECODED < z_min <= z_max < MAX_DECODED, depths)
    cameras = [
        camera_in(cursor.section, view, calibration(*cursor.unpack(L.INTRINSICS)), c2w, width, height)
        for view, c2w in enumerate(poses)
    ]
    layer = ExactLayer(tuple(cameras), degree, (z_min, z_max), digest, (), data)
    return replace(layer, streams=read_streams(cursor, len(poses) * layer.planes, data))
