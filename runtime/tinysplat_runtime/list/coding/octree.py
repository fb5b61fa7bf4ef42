"""Positions on a grid as an octree: a byte a cell for which of its eight parts are occupied: FORMAT.md, "Positions".

The order of points is not kept, which is what makes it cheap: the leaves come out along a Morton curve. A cell's byte
is put into one of four streams by how many parts its parent has, as lone parts tend to have lone parts; LZMA codes
the streams.
"""

import lzma
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import FormatError

GROUPS = 4
"""Streams of occupancy: cells whose parent has 1, 2, 3, or more parts."""

ESCAPE = 255
"""In the stream of further points per leaf: how many stands in the last stream."""

# Raw LZMA2 whose properties are fixed, so that a stream has none to be believed. Bytes hardly repeat in runs: what
# counts is the adaptive coding of single ones.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 0, "lp": 0, "pb": 0, "nice_len": 32, "dict_size": 1 << 16}]


@dataclass(frozen=True)
class CodedPoints:
    """Points ready for the file.

    Attributes:
        levels: cells of each level from the root, without the leaves.
        leaves: occupied leaves.
        escapes: leaves with more than `ESCAPE` further points.
        streams: `GROUPS` of occupancy, one of further points per leaf, one of those numbers that are large.
    """

    levels: tuple[int, ...]
    leaves: int
    escapes: int
    streams: tuple[bytes, ...]


_PARTS = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.int64)
"""Occupied parts by a cell's byte."""


def _groups(parts: NDArray) -> NDArray:
    """(n,) uint8 stream of the children of cells with so many parts."""
    return (np.minimum(parts, GROUPS) - 1).astype(np.uint8)


def encode_points(keys: NDArray, levels: int) -> CodedPoints:
    """Code (N,) uint64 sorted Morton keys below 8^levels; equal ones may repeat."""
    leaves, counts = np.unique(keys, return_counts=True)
    groups: list[list[NDArray]] = [[] for _ in range(GROUPS)]
    nodes, group, sizes = np.zeros(1, np.uint64), np.full(1, GROUPS - 1), []
    for depth in range(levels):
        sizes.append(len(nodes))
        parts = leaves >> np.uint64(3 * (levels - 1 - depth))
        parts = parts[np.diff(parts, prepend=parts[:1] + np.uint64(1)) != 0]
        parent = np.searchsorted(nodes, parts >> np.uint64(3))
        bits = np.left_shift(1, (parts & np.uint64(7)).astype(np.int64))
        occupied = np.bincount(parent, weights=bits, minlength=len(nodes)).astype(np.uint8)
        for number, stream in enumerate(groups):
            stream.append(occupied[group == number])
        group = _groups(np.bincount(parent, minlength=len(nodes)))[parent]
        nodes = parts
    further = counts - 1
    large = further[further >= ESCAPE]
    raw = [np.concatenate(stream or [np.zeros(0, np.uint8)]).tobytes() for stream in groups]
    raw += [np.minimum(further, ESCAPE).astype(np.uint8).tobytes(), large.astype("<u4").tobytes()]
    streams = tuple(lzma.compress(data, lzma.FORMAT_RAW, filters=_FILTERS) for data in raw)
    return CodedPoints(tuple(sizes), len(leaves), len(large), streams)


def decode_points(
    streams: Sequence[bytes | memoryview], levels: Sequence[int], leaves: int, escapes: int, count: int
) -> NDArray:
    """(count,) uint64 sorted Morton keys.

    Raises:
        FormatError: the streams do not come to the numbers of cells, leaves and points announced.
    """
    total = sum(levels)
    raw = [_decompressed(stream, total) for stream in streams[:GROUPS]]
    if sum(map(len, raw)) != total:
        raise FormatError(f"{sum(map(len, raw))} cells, announced are {total}", where="positions")
    taken = [0] * GROUPS
    nodes: NDArray = np.zeros(1, np.uint64)
    group: NDArray = np.full(1, GROUPS - 1, np.uint8)
    for depth, size in enumerate(levels):
        occupied = np.zeros(size, np.uint8)
        for number in range(GROUPS):
            is_mine = group == number
            cells = int(np.count_nonzero(is_mine))
            mine = raw[number][taken[number] : taken[number] + cells]
            taken[number] += cells
            if taken[number] > len(raw[number]):
                raise FormatError(f"stream {number} ends in level {depth}", where="positions")
            occupied[is_mine] = mine
        if not occupied.all():
            raise FormatError(f"an empty cell in level {depth}", where="positions")
        parts, following = _PARTS[occupied], [*levels, leaves][depth + 1]
        if int(parts.sum()) != following:
            raise FormatError(f"level {depth + 1} does not have the {following} cells announced", where="positions")
        places = np.flatnonzero(np.unpackbits(occupied, bitorder="little"))
        group = np.repeat(_groups(parts), parts)
        nodes = np.repeat(nodes << np.uint64(3), parts) | (places & 7).astype(np.uint64)
    return np.repeat(nodes, _points_per_leaf(streams, leaves, escapes, count))


def _points_per_leaf(streams: Sequence[bytes | memoryview], leaves: int, escapes: int, count: int) -> NDArray:
    further = _decompressed(streams[GROUPS], leaves).astype(np.int64)
    large = _decompressed(streams[GROUPS + 1], 4 * escapes)
    is_large = further == ESCAPE
    if len(further) != leaves or len(large) != 4 * escapes or int(is_large.sum()) != escapes:
        raise FormatError("points per cell are not those announced", where="positions")
    further[is_large] = large.view("<u4")
    if int(further.sum()) + leaves != count:
        raise FormatError(f"{int(further.sum()) + leaves} points, announced are {count}", where="positions")
    return further + 1


def _decompressed(data: bytes | memoryview, most: int) -> NDArray:
    """At most `most` bytes of a stream; FormatError for one that is damaged, cut or longer."""
    stream = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=_FILTERS)
    try:
        raw = stream.decompress(bytes(data), most + 1)
    except lzma.LZMAError as error:
        raise FormatError(f"LZMA: {error}", where="positions") from None
    if len(raw) > most or not stream.eof or stream.unused_data:
        raise FormatError(f"a stream does not come to {most} bytes or less", where="positions")
    return np.frombuffer(raw, np.uint8)
