"""Sections of the modes beyond Gaussian planes: the network that a receiver runs, and the photos that it runs on.

Layout: docs/FORMAT.md, sections NETW and PHOT. Reading checks every number and length, as reader.py does.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING
from zlib import crc32

from ..errors import FormatError
from .layout import MAX_SIDE, PARAMETER_SETS, STREAM, StreamRef

if TYPE_CHECKING:
    from .reader import Cursor

NETWORK = b"NETW"
PHOTOS = b"PHOT"
PHOTO_PICTURES = b"PICS"

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
class CodedPhotos:
    """Photos ready for the file: parameter sets with start codes, and one slice NAL unit each."""

    height: int
    width: int
    qp: int
    parameter_sets: bytes
    payloads: tuple[bytes, ...]


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


def read_network(cursor: Cursor) -> NetworkRef:
    """Parse and check a NETW section."""
    digest, raw_name, near, far = cursor.unpack(NETWORK_FIXED)
    cursor.finish()
    name = raw_name.rstrip(b"\0")
    cursor.require(name.isascii() and name.decode("latin-1").isprintable(), "the network's name is not printable ASCII")
    cursor.require(0 < near < far < _MAX_DEPTH, f"near {near:g} and far {far:g}, expected 0 < near < far")
    return NetworkRef(name.decode("ascii"), digest.hex(), near, far)


def read_photos(cursor: Cursor, views: int, data: memoryview) -> PhotoHeader:
    """Parse and check a PHOT section; `data` are the bytes of the pictures."""
    height, width, pixel_format, qp, parameter_set, _ = cursor.unpack(PHOTOS_FIXED)
    sides = f"photos of {width}x{height}, sides are 1 to {MAX_SIDE}"
    cursor.require(1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE, sides)
    cursor.require(pixel_format == YCC_420_10, f"photo format {pixel_format} is unknown")
    cursor.require(qp <= 51, f"QP {qp}, accepted are 0 to 51")
    streams, end = [], 0
    for _ in range(views):
        length, crc = cursor.unpack(STREAM)
        streams.append(StreamRef(end, length, crc))
        end += length
    cursor.finish()
    cursor.require(end == len(data), f"{len(data)} bytes of pictures, {end} announced")
    return PhotoHeader(height, width, qp, parameter_set, tuple(streams), data)
