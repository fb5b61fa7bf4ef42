"""Sections of the modes beyond coded planes: a network and the photos that it runs on, or planes that are exact.

Layout: docs/FORMAT.md, sections NETW, PHOT and EXAC. Reading checks every number and length, as reader.py does.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

from numpy.typing import NDArray

from ..errors import FormatError, InputError
from ..gaussian.planes import MAX_QP
from ..gaussian.sh import MAX_SH_DEGREE
from ..scene.cameras import Camera
from .layout import INTRINSICS, MAX_SIDE, PARAMETER_SETS, STREAM
from .records import ExactLayer, Limits, NetworkRef, PhotoHeader, StreamRef, exact_plane_count
from .sections import Cursor, Section, only

NETWORK = b"NETW"
PHOTOS = b"PHOT"
PHOTO_PICTURES = b"PICS"

EXACT = b"EXAC"
EXACT_PLANES = b"EXAP"

EXACT_FIXED = struct.Struct("<IIB3sff32s")
"""height, width, SH degree, reserved (0), least z, largest z, SHA-256 of the planes; then per view INTRINSICS, and per
view and plane a STREAM."""

NETWORK_FIXED = struct.Struct("<32s64sdd")
"""sha256 of the ONNX file, its name (ASCII, zero-padded), near, far in scene units."""

PHOTOS_FIXED = struct.Struct("<IIBBBB")
"""height, width, format, QP, parameter-set index, reserved (0); then per view a STREAM."""

YCC_420_10 = 0
"""Format: BT.709 YCbCr of full range, 4:2:0, 10 bits."""

PHOTO_SIDE_MULTIPLE = 16
PHOTO_PARAMETER_SET = 255
"""Index of the HEVC section that the writer gives to photos; layers count from 0."""

_MAX_DEPTH = 1e30


@dataclass(frozen=True)
class CodedPhotos:
    """Photos ready for the file: parameter sets with start codes, and one slice NAL unit each."""

    height: int
    width: int
    qp: int
    parameter_sets: bytes
    payloads: tuple[bytes, ...]


@dataclass(frozen=True)
class CodedExact:
    """A layer of exact planes ready for the file: a payload per view and plane, views outermost."""

    cameras: tuple[Camera, ...]
    degree: int
    depth_limits: tuple[float, float]
    sha256: bytes
    payloads: tuple[bytes, ...]


def network_section(network: NetworkRef) -> tuple[bytes, int, bytes]:
    """The section that names a network; a longer name is cut."""
    name = network.name.encode("ascii", "replace")[:64]
    return NETWORK, 0, NETWORK_FIXED.pack(bytes.fromhex(network.sha256), name, network.near, network.far)


def photo_sections(photos: CodedPhotos) -> list[tuple[bytes, int, bytes]]:
    """The sections of coded photos."""
    fixed = PHOTOS_FIXED.pack(photos.height, photos.width, YCC_420_10, photos.qp, PHOTO_PARAMETER_SET, 0)
    table = b"".join(STREAM.pack(len(payload), crc32(payload)) for payload in photos.payloads)
    return [
        (PHOTOS, 0, fixed + table),
        (PARAMETER_SETS, PHOTO_PARAMETER_SET, photos.parameter_sets),
        (PHOTO_PICTURES, 0, b"".join(photos.payloads)),
    ]


def exact_sections(layer: CodedExact, index: int) -> list[tuple[bytes, int, bytes]]:
    """The sections of a layer of exact planes."""
    first = layer.cameras[0]
    fixed = EXACT_FIXED.pack(first.height, first.width, layer.degree, b"", *layer.depth_limits, layer.sha256)
    matrices = [camera.K for camera in layer.cameras]
    intrinsics = b"".join(INTRINSICS.pack(K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1]) for K in matrices)
    table = b"".join(STREAM.pack(len(payload), crc32(payload)) for payload in layer.payloads)
    return [(EXACT, index, fixed + intrinsics + table), (EXACT_PLANES, index, b"".join(layer.payloads))]


def _read_exact(cursor: Cursor, poses: Sequence[NDArray], data: memoryview) -> ExactLayer:
    """Parse and check an EXAC section; `data` are the bytes of its planes, `poses` c2w per view."""
    height, width, degree, _, z_min, z_max, digest = cursor.unpack(EXACT_FIXED)
    cursor.require(1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE, f"grid {width}x{height}, sides 1 to {MAX_SIDE}")
    cursor.require(degree <= MAX_SH_DEGREE, f"SH degree {degree}, accepted are 0 to {MAX_SH_DEGREE}")
    depths = f"depth limits {z_min:g} to {z_max:g}, expected positive and ordered"
    cursor.require(1 / _MAX_DEPTH < z_min <= z_max < _MAX_DEPTH, depths)
    cameras = []
    for view, c2w in enumerate(poses):
        fx, fy, cx, cy, skew = cursor.unpack(INTRINSICS)
        try:
            cameras.append(Camera([[fx, skew, cx], [0, fy, cy], [0, 0, 1]], c2w, width, height))  # type: ignore[arg-type]
        except InputError as error:
            where = f"{cursor.section.label}: view {view}: {error.where}"
            raise FormatError(error.message, where=where) from None
    streams = _read_streams(cursor, len(poses) * exact_plane_count(degree), data)
    return ExactLayer(tuple(cameras), degree, (z_min, z_max), digest, streams, data)


def _read_streams(cursor: Cursor, count: int, data: memoryview) -> tuple[StreamRef, ...]:
    """The table at a section's end: `count` lengths, which add up to that of `data`, with CRCs."""
    streams, end = [], 0
    for _ in range(count):
        length, crc = cursor.unpack(STREAM)
        streams.append(StreamRef(end, length, crc))
        end += length
    cursor.finish()
    cursor.require(end == len(data), f"{len(data)} bytes behind it, {end} announced")
    return tuple(streams)


def _read_network(cursor: Cursor) -> NetworkRef:
    """Parse and check a NETW section."""
    digest, raw_name, near, far = cursor.unpack(NETWORK_FIXED)
    cursor.finish()
    name = raw_name.rstrip(b"\0")
    cursor.require(name.isascii() and name.decode("latin-1").isprintable(), "the network's name is not printable ASCII")
    depths = f"near {near:g} and far {far:g}, expected {1 / _MAX_DEPTH:g} < near < far < {_MAX_DEPTH:g}"
    cursor.require(1 / _MAX_DEPTH < near < far < _MAX_DEPTH, depths)
    return NetworkRef(name.decode("ascii"), digest.hex(), near, far)


def _read_photos(cursor: Cursor, views: int, data: memoryview) -> PhotoHeader:
    """Parse and check a PHOT section; `data` are the bytes of the pictures."""
    height, width, pixel_format, qp, parameter_set, _ = cursor.unpack(PHOTOS_FIXED)
    sides = f"photos of {width}x{height}, sides are 1 to {MAX_SIDE}"
    cursor.require(1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE, sides)
    cursor.require(pixel_format == YCC_420_10, f"photo format {pixel_format} is unknown")
    cursor.require(qp <= MAX_QP, f"QP {qp}, accepted are 0 to {MAX_QP}")
    streams = _read_streams(cursor, views, data)
    return PhotoHeader(height, width, qp, parameter_set, streams, data)


def read_photo_mode(sections: Sequence[Section], views: int) -> tuple[NetworkRef | None, PhotoHeader | None]:
    """The network and the photos of a file that has them; FormatError for one without the other."""
    if not {NETWORK, PHOTOS, PHOTO_PICTURES} & {section.kind for section in sections}:
        return None, None
    network = _read_network(Cursor(only(sections, NETWORK)))
    pictures = only(sections, PHOTO_PICTURES)
    return network, _read_photos(Cursor(only(sections, PHOTOS)), views, pictures.data)


def read_exact_layers(
    sections: Sequence[Section], count: int, poses: Sequence[NDArray], limits: Limits
) -> tuple[ExactLayer, ...]:
    """The layers of exact planes, () for a file of another mode; `poses` are c2w per view.

    Raises:
        FormatError: damaged, or beyond the limits.
    """
    if EXACT not in {section.kind for section in sections}:
        return ()
    layers = []
    pixels = memory = 0
    for index in range(count):
        planes = only(sections, EXACT_PLANES, index)
        layer = _read_exact(Cursor(only(sections, EXACT, index)), poses, planes.data)
        pixels += layer.gaussians
        memory += 12 * layer.gaussians * layer.planes  # float16, float64 and float32 at a time
        if pixels > limits.max_pixels or memory > limits.max_memory_bytes:
            found = f"{pixels} Gaussians, {memory} bytes to decode: over --max-pixels or --max-memory"
            raise FormatError(found, where=f"section EXAC[{index}]")
        layers.append(layer)
    return tuple(layers)
