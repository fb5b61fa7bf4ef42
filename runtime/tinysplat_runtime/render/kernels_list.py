"""Which splats reach which tiles, in order of depth, as compiled code."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..system.kernels_compile import Number, compiled, within
from .kernels_project import BOTTOM, DEPTH, LEFT, RIGHT, TOP

TILE_WIDTH, TILE_HEIGHT = 128, 32
"""Pixels: as large as a core's L2 cache likes."""

DIGITS = 4096
"""Most buckets of a pass of the radix sort."""

_F, _I, _ZERO = np.float32, np.uint64, np.float32(0)


class Visible(NamedTuple):
    """What of a block a frame shows.

    Attributes:
        ids: (m,) int32 rows of records.
        boxes: (m, 4) int16 their first and last column and row of tiles.
        counts: (tiles,) int64 how many by tile.
    """

    ids: NDArray
    boxes: NDArray
    counts: NDArray


class Tiles(NamedTuple):
    """Some tiles of a picture, one after the other: the first, the one behind the last, and how many are in a row."""

    first: int
    stop: int
    columns: int


class Listed(NamedTuple):
    """A tile's list, as from `list_by_tile`.

    Attributes:
        records: (N, 16) float32, of all splats.
        rows: (pairs,) int32, the record of every pair.
        keys: of the tile's pairs; sorting changes them.
        scratch: as long.
    """

    records: NDArray
    rows: NDArray
    keys: NDArray
    scratch: NDArray


@compiled
def list_visible(records: NDArray, first: Number, columns: Number, found: Visible) -> Number:
    """List the visible splats of a block and count them by tile.

    Args:
        records: (n, 16) float32, of the block.
        first: row of its first record.
        columns: tiles in a row of tiles.
        found: filled; as long as the block.

    Returns:
        How many are visible.
    """
    shown, ids, boxes, counts = 0, found.ids, found.boxes, found.counts
    counts[:] = 0
    for row in range(len(records)):
        if records[row, RIGHT] >= _ZERO:
            ids[shown] = first + row
            left, right = int(records[row, LEFT]) // TILE_WIDTH, int(records[row, RIGHT]) // TILE_WIDTH
            top, bottom = int(records[row, TOP]) // TILE_HEIGHT, int(records[row, BOTTOM]) // TILE_HEIGHT
            boxes[shown, 0], boxes[shown, 1], boxes[shown, 2], boxes[shown, 3] = left, right, top, bottom
            for tile_row in range(top, bottom + 1):
                for tile in range(tile_row * columns + left, tile_row * columns + right + 1):
                    counts[tile] += 1
            shown += 1
    return shown


@within
def rows_of(reached: NDArray, tiles: Tiles) -> tuple[Number, Number]:
    """First row in which a splat, `reached` (4,) int its box, has some of `tiles`, and the one behind the last."""
    return max(reached[2], tiles.first // tiles.columns), min(reached[3], (tiles.stop - 1) // tiles.columns) + 1


@within
def tiles_of(reached: NDArray, tiles: Tiles, row: Number) -> tuple[Number, Number]:
    """As `rows_of` within a row: number of the first tile, and of the one behind the last."""
    start = row * tiles.columns
    return max(start + reached[0], tiles.first), min(start + reached[1] + 1, tiles.stop)


@compiled
def list_by_tile(records: NDArray, seen: Visible, tiles: Tiles, ends: NDArray, keys: NDArray, rows: NDArray) -> None:
    """Append a block's splats to the lists of some tiles.

    Args:
        records: (N, 16), of all blocks.
        seen: the block's.
        tiles: which.
        ends: (tiles,) int64, where each list goes on; moved on.
        keys: uint64: bits of the depth, which rise as depths do, above the pair's place.
        rows: (pairs,) int32, the record of every place.
    """
    for entry in range(seen.ids.size):
        reached, row = seen.boxes[entry], seen.ids[entry]
        depth = _I(_F(records[row, DEPTH]).view(np.uint32)) << _I(32)
        for tile_row in range(*rows_of(reached, tiles)):
            for tile in range(*tiles_of(reached, tiles, tile_row)):
                pair = ends[tile - tiles.first]
                keys[pair] = depth | _I(pair)
                rows[pair] = row
                ends[tile - tiles.first] += 1


@within
def sort_by_depth(keys: NDArray, scratch: NDArray, histogram: NDArray) -> NDArray:
    """Sort (m,) uint64 by the upper 32 bits, ties in order: a radix sort of as few passes as the range needs."""
    low, high = keys[0] >> _I(32), keys[0] >> _I(32)
    for key in keys:
        low, high = min(low, key >> _I(32)), max(high, key >> _I(32))
    shift, digit_bits = _I(0), _I(5 if keys.size < 256 else (8 if keys.size < 2048 else 12))
    mask = (_I(1) << digit_bits) - _I(1)
    while (high - low) >> shift:
        histogram[: mask + _I(1)] = 0
        for key in keys:
            histogram[(((key >> _I(32)) - low) >> shift) & mask] += 1
        end = 0
        for digit in range(int(mask) + 1):
            count = histogram[digit]
            histogram[digit] = end
            end += count
        for key in keys:
            digit = (((key >> _I(32)) - low) >> shift) & mask
            scratch[histogram[digit]] = key
            histogram[digit] += 1
        keys, scratch = scratch, keys
        shift += digit_bits
    return keys
