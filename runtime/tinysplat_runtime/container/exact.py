"""Body `Exact`, of mode lossless: layers of planes as float16, bit for bit. Layout: docs/FORMAT.md, section EXAC."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..errors import FormatError
from ..gaussian.planes import MAX_DECODED, PlaneClass
from ..gaussian.sh import MAX_SH_DEGREE
from ..scene.cameras import Camera
from . import layout as L
from .body import Body, Description, Opened, check_totals
from .cameras import has_own_intrinsics, packed_intrinsics
from .layers import PixelGrid
from .records import ChannelRecord, Picture
from .sections import Cursor, NewSection
from .table import Row

EXACT = b"EXAC"

EXACT_FIXED = struct.Struct("<IIBB2sff32s")
"""height, width, SH degree, flags, reserved (0), least z, largest z, SHA-256 of the planes; then intrinsics where flags
have OWN_INTRINSICS, which is the only one."""


@dataclass(frozen=True)
class ExactLayer(PixelGrid):
    """A layer of exact planes: its grid, and its planes, a row of pictures each."""

    cameras: tuple[Camera, ...]
    degree: int
    depth_limits: tuple[float, float]
    sha256: bytes
    rows: tuple[tuple[Picture, ...], ...]

    @property
    def planes(self) -> int:
        """Planes of a view: 12 of geometry, and all SH coefficients."""
        return 12 + 3 * (self.degree + 1) ** 2

    def payload(self, view: int, plane: int) -> memoryview:
        """One plane's bytes; FormatError where they are cut off or altered."""
        return self.rows[plane][view].checked(f"exact plane {plane}, view {view}")


@dataclass(frozen=True, kw_only=True)
class Exact(Body):
    """Layers of exact planes."""

    mode: ClassVar[str] = "lossless"
    sign: ClassVar[bytes] = EXACT
    kinds: ClassVar[frozenset[bytes]] = frozenset({L.CAMERAS, EXACT})

    layers: tuple[ExactLayer, ...]

    @classmethod
    def read(cls, file: Opened) -> Exact:
        """Parse and check the sections EXAC."""
        file.check_counts()
        file.check_rows([PlaneClass.EXACT])
        layers: list[ExactLayer] = []
        pixels = memory = 0
        for index in range(file.layer_count):
            layer = _read_exact(file, index)
            pixels += layer.gaussians
            memory += 12 * layer.gaussians * layer.planes  # float16, float64 and float32 at a time
            check_totals(pixels, memory, file.limits, f"section EXAC[{index}]")
            layers.append(layer)
        return cls(cameras=file.cameras, layers=tuple(layers))

    def describe(self) -> Description:
        """Gaussians, of which all is kept."""
        gaussians = sum(layer.gaussians for layer in self.layers)
        return Description(gaussians=gaussians, sh_degree=self.layers[0].degree)


def exact_section(layer: ExactLayer, index: int, cameras: Sequence[Camera]) -> NewSection:
    """The section of a layer of exact planes, of a file with such cameras."""
    first, has_own = layer.cameras[0], has_own_intrinsics(cameras, layer.cameras)
    flags = L.OWN_INTRINSICS * has_own
    fixed = EXACT_FIXED.pack(first.height, first.width, layer.degree, flags, b"", *layer.depth_limits, layer.sha256)
    return NewSection(EXACT, index, fixed + (packed_intrinsics(layer.cameras) if has_own else b""))


def exact_rows(layer: ExactLayer, index: int) -> list[Row]:
    """Its rows of the table of pictures."""
    return [(index, ChannelRecord(PlaneClass.EXACT, n, 0, 0.0, 0.0, own)) for n, own in enumerate(layer.rows)]


def _read_exact(file: Opened, index: int) -> ExactLayer:
    cursor = Cursor(file.only(EXACT, index))
    height, width, degree, flags, _, z_min, z_max, digest = cursor.unpack(EXACT_FIXED)
    cursor.require(
        1 <= height <= L.MAX_SIDE and 1 <= width <= L.MAX_SIDE, f"grid {width}x{height}, sides 1 to {L.MAX_SIDE}"
    )
    cursor.require(degree <= MAX_SH_DEGREE, f"SH degree {degree}, accepted are 0 to {MAX_SH_DEGREE}")
    cursor.require(not flags & ~L.OWN_INTRINSICS, f"unknown flags {flags:#x}")
    depths = f"depth limits {z_min:g} to {z_max:g}, expected positive and ordered"
    cursor.require(1 / MAX_DECODED < z_min <= z_max < MAX_DECODED, depths)
    if not index:
        file.check_sizes(height, width, cursor.section.label)
    cameras = file.layer_cameras(cursor, height, width, has_own=bool(flags))
    cursor.finish()
    records = file.table.layer(index)
    layer = ExactLayer(cameras, degree, (z_min, z_max), digest, tuple(record.pictures for record in records))
    found = [record.target for record in records if record.pictures]
    if found != list(range(layer.planes)) or len(records) != layer.planes:
        listed = f"{len(found)} planes of layer {index}, expected {layer.planes}, each with pictures and in order"
        raise FormatError(listed, where="section PICT[0]")
    return layer
