"""The framing of SPZ files: a header and blocks of bytes, one row per point, out of a file and into it.

Versions 1 to 3 are one gzip stream of a 16-byte header and the blocks. Version 4 is a 32-byte header, extension
records, a table of sizes, and a zstd stream per block, through the package zstandard (extra `io`). What the bytes mean
is in `spz`. Source: README.md and extensions/README.md of github.com/nianticlabs/spz.

Trust boundary: the header's count is held against a bound on memory before anything more is inflated, and nothing is
inflated past the bytes that the header calls for.
"""

import gzip
import io
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..system.files import parsing
from .axes import SPZ_AXES, SPZ_SYSTEMS

READS = (1, 2, 3, 4)
"""Versions that are read."""

MAX_DEGREE = 4
MAX_FRACTIONAL_BITS = 30  # readers shift a 32-bit 1 by it

_MAGIC, _ZSTD_VERSION = 0x5053474E, 4
_HEADER = struct.Struct("<IIIBBBB")
"""magic, version, points, SH degree, fractional bits, flags, reserved (0)."""
_LONG_HEADER = struct.Struct("<IIIBBBBI12s")
"""magic, version, points, SH degree, fractional bits, flags, streams, offset of the table, reserved (0)."""
_TABLE_ROW = struct.Struct("<QQ")
"""Bytes of a stream compressed and not."""
_EXTENSION = struct.Struct("<II")
"""Type and length of an extension record."""

_ANTIALIASED, _HAS_EXTENSIONS = 1, 2
_AXES_EXTENSION = 0xADBE0003  # SPZ_ADOBE_coordinate_system
_GZIP_LEVEL = 6  # level 9 takes twelve times as long for a thirtieth of the bytes
_ZSTD_LEVEL = 12
_MAX_WINDOW_BYTES = 1 << 27  # zstd's own bound on a decoder's memory


@dataclass(frozen=True)
class SpzHeader:
    """What all versions state.

    Attributes:
        version: one of READS.
        count: points, 1 or more.
        degree: of SH, 0 to MAX_DEGREE.
        fractional_bits: of positions, 0 to MAX_FRACTIONAL_BITS.
        antialiased: whether the Gaussians were trained for antialiased drawing.
        axes: number of the coordinate system that an extension says they are in.
    """

    version: int
    count: int
    degree: int
    fractional_bits: int
    antialiased: bool = False
    axes: int = SPZ_AXES

    @property
    def widths(self) -> tuple[int, ...]:
        """Bytes of a point in each block: positions, opacities, colours, scales, rotations, higher SH."""
        higher = 3 * ((self.degree + 1) ** 2 - 1)
        return (6 if self.version == 1 else 9), 1, 3, 3, (4 if self.version >= 3 else 3), higher


def pack_blocks(header: SpzHeader, blocks: Sequence[NDArray]) -> bytes:
    """A file's bytes; the same blocks give the same bytes.

    Args:
        header: of one of SPZ_VERSIONS.
        blocks: (N, width) uint8 in the order of `SpzHeader.widths`.

    Raises:
        ImportError: version 4, and zstandard is not installed.
    """
    parts = [np.ascontiguousarray(block).tobytes() for block in blocks]
    fields = (
        _MAGIC,
        header.version,
        header.count,
        header.degree,
        header.fractional_bits,
        _ANTIALIASED * header.antialiased,
    )
    if header.version < _ZSTD_VERSION:
        return gzip.compress(_HEADER.pack(*fields, 0) + b"".join(parts), _GZIP_LEVEL, mtime=0)
    import zstandard

    parts = [part for part in parts if part]  # no stream without bytes, as the format's own library has it
    streams = [zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(part) for part in parts]
    table = b"".join(_TABLE_ROW.pack(len(stream), len(part)) for stream, part in zip(streams, parts, strict=True))
    head = _LONG_HEADER.pack(*fields, len(streams), _LONG_HEADER.size, bytes(12))
    return b"".join((head, table, *streams))


def read_blocks(file: BinaryIO, max_bytes: int) -> tuple[SpzHeader, list[NDArray]]:
    """Read a file's header and its blocks, (N, width) uint8 each.

    Raises:
        InputError: damaged, of an unknown version, or its Gaussians take more than `max_bytes`.
        ImportError: version 4, and zstandard is not installed.
    """
    is_framed = file.read(4) == struct.pack("<I", _MAGIC)
    file.seek(0)
    with parsing(".spz file"):
        if is_framed:
            return _read_zstd(file.read(), max_bytes)
        with gzip.open(file) as stream:
            return _read_gzip(stream, max_bytes)


def _header(fields: Sequence[int], max_bytes: int) -> SpzHeader:
    magic, version, count, degree, bits, flags = fields
    if magic != _MAGIC:
        raise InputError("does not hold an SPZ header")
    if version not in READS:
        raise InputError(f"SPZ version {version}, accepted are {READS[0]} to {READS[-1]}")
    if not count or degree > MAX_DEGREE or bits > MAX_FRACTIONAL_BITS:
        raise InputError(f"damaged header: {count} points of SH degree {degree}, {bits} fractional bits")
    if count * (11 + 3 * (degree + 1) ** 2) * 8 > max_bytes:  # the Gaussians, in float64
        raise InputError(f"announces {count} points, more than {max_bytes} bytes can hold")
    return SpzHeader(version, count, degree, bits, bool(flags & _ANTIALIASED))


def _read_gzip(stream: gzip.GzipFile, max_bytes: int) -> tuple[SpzHeader, list[NDArray]]:
    try:
        data = stream.read(_HEADER.size)
        if len(data) < _HEADER.size:
            raise InputError("cut short in its header")
        header = _header(_HEADER.unpack(data)[:6], max_bytes)
        if header.version >= _ZSTD_VERSION:
            raise InputError(f"SPZ version {header.version} in a gzip stream, which ends with version 3")
        return header, [_block(stream.read(header.count * width), header.count, width) for width in header.widths]
    except (EOFError, zlib.error, OSError) as error:
        raise InputError(f"damaged gzip stream ({str(error)[:80]})") from None


def _read_zstd(data: bytes, max_bytes: int) -> tuple[SpzHeader, list[NDArray]]:
    if len(data) < _LONG_HEADER.size:
        raise InputError("cut short in its header")
    *fields, flags, streams, table, _ = _LONG_HEADER.unpack_from(data)
    header = _header((*fields, flags), max_bytes)
    if header.version < _ZSTD_VERSION:
        raise InputError(f"SPZ version {header.version} outside a gzip stream, where version 4 begins")
    widths = [width for width in header.widths if width]
    at = table + streams * _TABLE_ROW.size
    if streams != len(widths) or table < _LONG_HEADER.size or at > len(data):
        raise InputError(f"{streams} streams with a table at byte {table} of {len(data)}, expected {len(widths)}")
    if flags & _HAS_EXTENSIONS:
        header = replace(header, axes=_axes(data[_LONG_HEADER.size : table]))
    blocks = []
    for i, width in enumerate(widths):
        packed, plain = _TABLE_ROW.unpack_from(data, table + i * _TABLE_ROW.size)
        if plain != header.count * width or packed > len(data) - at:
            raise InputError(f"stream {i} of {packed} bytes for {plain}, expected {header.count * width}: cut short?")
        blocks.append(_block(_inflate(data[at : at + packed], plain), header.count, width))
        at += packed
    if at != len(data):
        raise InputError(f"{len(data) - at} bytes behind its last stream")
    return header, blocks if len(blocks) == len(header.widths) else [*blocks, np.zeros((header.count, 0), np.uint8)]


def _axes(records: bytes) -> int:
    """The coordinate system by the one extension that changes what the streams mean; others add to them."""
    at, stated = 0, SPZ_AXES
    while at + _EXTENSION.size <= len(records):
        kind, length = _EXTENSION.unpack_from(records, at)
        at += _EXTENSION.size
        if kind == _AXES_EXTENSION:
            stated = int.from_bytes(records[at : at + length], "little") or SPZ_AXES
            if stated > SPZ_SYSTEMS:
                raise InputError(f"coordinate system {stated} of an extension, expected at most {SPZ_SYSTEMS}")
        at += length
    return stated


def _inflate(stream: bytes, size: int) -> bytes:
    """`size` bytes of a zstd stream; fewer where it is cut short."""
    import zstandard

    source: BinaryIO = io.BytesIO(stream)
    reader: Any = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW_BYTES).stream_reader(source)
    try:
        return bytes(reader.read(size))
    except zstandard.ZstdError as error:
        raise InputError(f"damaged zstd stream ({str(error)[:80]})") from None


def _block(data: bytes, count: int, width: int) -> NDArray:
    if len(data) < count * width:
        raise InputError(f"cut short: announces {count} points")
    return np.frombuffer(data, np.uint8).reshape(count, width)
