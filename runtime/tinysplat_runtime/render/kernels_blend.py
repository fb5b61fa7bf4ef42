"""Depth order and compositing as compiled code: the definition of `composite.py`, a tile of pixels at a time.

A tile's splats are sorted by depth and blended one row of one splat at a time, eight pixels to a vector instruction.
Where numpy needs lists of splats of every 4×4 pixels to have long arrays, a loop needs none: a tile is as large as a
core's L2 cache likes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .composite import ALPHA_MAX, TRANSMITTANCE_MIN
from .kernels_project import (
    ALPHA_X,
    BETA_X,
    BLUE,
    BOTTOM,
    DEPTH,
    GAMMA,
    GREEN,
    LAST,
    LEFT,
    LOG_OPACITY,
    REACH,
    RED,
    RIGHT,
    TOP,
    Number,
    X,
    Y,
    compiled,
)
from .prepare import ALPHA_MIN
from .project import MARGIN_PX

TILE_WIDTH, TILE_HEIGHT = 128, 32

LANES = 8
"""Pixels blended together: the floats of a 32-byte vector."""

PLANES = 5
"""What a pixel gathers: transmittance, negative once it has stopped; red, green, blue; Σ w·z."""

_F, _I = np.float32, np.uint64
_STRIDE = TILE_WIDTH + LANES  # a vector may begin at any pixel, so that it may end beyond the tile
_ROW = PLANES * _STRIDE
STATE = TILE_HEIGHT * _ROW
_RED, _GREEN, _BLUE, _DEPTH = (_I(plane * _STRIDE) for plane in range(1, PLANES))
_ALPHA_MIN, _ALPHA_MAX, _LOG_ALPHA_MIN = _F(ALPHA_MIN), _F(ALPHA_MAX), _F(math.log(ALPHA_MIN))
_HALF, _MARGIN, _ZERO = _F(0.5), _F(MARGIN_PX), _F(0)

AHEAD = 256
"""Splats whose records are brought near before they are blended: the misses of a loop that only copies overlap, which
those of blending do not (1.8 of 15.5 ms for 131,072 Gaussians). After each batch a tile without an open pixel is done.
"""

DIGITS = 4096
"""Most buckets of a pass of the radix sort."""


@compiled
def list_visible(
    records: NDArray, first: Number, columns: Number, ids: NDArray, boxes: NDArray, counts: NDArray
) -> Number:
    """List the visible splats of a block and count them by tile.

    Args:
        records: (n, 16), of the block.
        first: row of its first record.
        columns: tiles in a row of tiles.
        ids: (n,) int32, filled with rows of visible splats.
        boxes: (n, 4) int16, filled with their first and last column and row of tiles.
        counts: (tiles,) int64, filled with splats by tile.

    Returns:
        How many are visible.
    """
    shown = 0
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


@compiled
def list_by_tile(
    records: NDArray,
    ids: NDArray,
    boxes: NDArray,
    columns: Number,
    tiles: tuple[Number, Number],
    ends: NDArray,
    out: NDArray,
) -> None:
    """Append a block's splats to the lists of some tiles.

    Args:
        records: (N, 16), of all blocks.
        ids, boxes: the visible splats, as from `list_visible`.
        columns: tiles in a row of tiles.
        tiles: first, and the one behind the last.
        ends: (tiles,) int64, where each list goes on in `out`; moved on.
        out: uint64: bits of the depth, which rise as depths do, above the row of the record.
    """
    for entry in range(ids.size):
        left, right, top, bottom = boxes[entry, 0], boxes[entry, 1], boxes[entry, 2], boxes[entry, 3]
        row = ids[entry]
        key = (_I(_F(records[row, DEPTH]).view(np.uint32)) << _I(32)) | _I(row)
        for tile_row in range(max(top, tiles[0] // columns), min(bottom, (tiles[1] - 1) // columns) + 1):
            start = tile_row * columns
            for tile in range(max(start + left, tiles[0]), min(start + right + 1, tiles[1])):
                out[ends[tile - tiles[0]]] = key
                ends[tile - tiles[0]] += 1


@compiled
def sort_by_depth(keys: NDArray, scratch: NDArray, histogram: NDArray) -> NDArray:
    """Sort by the upper 32 bits, ties in their order: a radix sort of as few passes as the depths' range needs."""
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


@compiled
def composite_tile(
    records: NDArray,
    keys: NDArray,
    scratch: NDArray,
    corner: tuple[Number, Number],
    workspace: tuple[NDArray, NDArray, NDArray],
    canvas: tuple[NDArray, NDArray, NDArray],
    has_front: bool,
) -> None:
    """Blend a tile's splats into the picture.

    Args:
        records: (N, 16) float32.
        keys: the tile's list, as from `list_by_tile`; changed.
        scratch: as long.
        corner: row and column of the tile's first pixel.
        workspace: (`STATE`,) and (`AHEAD`, 16) float32, (`DIGITS`,) int64.
        canvas: (H, W, 3) and (H, W) float32, (H, W) too or (0, 0): colour, transmittance and depth, written where the
            tile lies.
        has_front: whether splats are blended twice: with a share of their opacity, whose logarithm is the last number
            of their records, and after all of those as they are.
    """
    state, near, histogram = workspace
    colour, transmittance, depth = canvas
    row, column = corner
    rows, columns = min(TILE_HEIGHT, len(colour) - row), min(TILE_WIDTH, colour.shape[1] - column)
    state[:] = 0
    for line in range(rows):
        state[line * _ROW : line * _ROW + columns] = 1
    keys = sort_by_depth(keys, scratch, histogram)
    for is_whole in range(1 - has_front, 2):
        for start in range(0, keys.size, AHEAD):
            if start and not is_open(state):
                break
            count = 0
            for key in keys[start : start + AHEAD]:
                near[count] = records[key & _I(0xFFFFFFFF)]
                if not is_whole:
                    near[count, LOG_OPACITY] += near[count, LAST]
                count += near[count, LOG_OPACITY] >= _LOG_ALPHA_MIN
            for entry in range(count):
                blend_splat(near[entry], row, column, rows, columns, state)
    for line in range(rows):
        for lane in range(columns):
            at = line * _ROW + lane
            transmittance[row + line, column + lane] = abs(state[at])
            for channel in range(3):
                colour[row + line, column + lane, channel] = state[at + (1 + channel) * _STRIDE]
            if depth.size:
                depth[row + line, column + lane] = state[at + 4 * _STRIDE]


@compiled
def is_open(state: NDArray) -> bool:
    """Whether any pixel of a tile still lets something through."""
    for row in range(TILE_HEIGHT):
        for column in range(TILE_WIDTH):
            if state[row * _ROW + column] > _ZERO:
                return True
    return False


@compiled
def blend_splat(
    splat: NDArray, first_row: Number, first_column: Number, rows: Number, columns: Number, state: NDArray
) -> None:
    """Blend one splat into a tile."""
    x, y, alpha_x, beta_x, gamma = splat[X] - _F(first_column), splat[Y], splat[ALPHA_X], splat[BETA_X], splat[GAMMA]
    log_opacity, reach = splat[LOG_OPACITY], splat[REACH]
    colour = splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH]
    tau = log_opacity - _LOG_ALPHA_MIN
    left, right, top, bottom = box(splat, first_row, first_column, rows, columns)
    for row in range(top, bottom + 1):
        dy = _F(row) + _HALF - y
        fall = gamma * dy * (gamma * dy)
        if reach > _ZERO:
            if fall > tau:
                continue
            left, right = chord(x - beta_x * dy * reach, math.sqrt(tau - fall) * reach, columns)
        # Unsigned, as a signed index might be negative and count from the end, which no vector can.
        start = _I((row - first_row) * _ROW)
        for column in range(left, right + 1, LANES):
            across = alpha_x * (_F(column) + _HALF - x) + beta_x * dy
            _blend_lanes(state, start + _I(column), across, alpha_x, log_opacity - fall, colour)


@compiled
def box(
    splat: NDArray, first_row: Number, first_column: Number, rows: Number, columns: Number
) -> tuple[Number, Number, Number, Number]:
    """First and last column of a tile that a splat may reach, and first and last row of the picture."""
    return (
        max(int(splat[LEFT]) - first_column, 0),
        min(int(splat[RIGHT]) - first_column, columns - 1),
        max(int(splat[TOP]), first_row),
        min(int(splat[BOTTOM]), first_row + rows - 1),
    )


@compiled
def chord(middle: Number, half: Number, columns: Number) -> tuple[Number, Number]:
    """First and last column of a tile whose centres lie within a chord, and a little around it."""
    half += _MARGIN
    return int(max(np.ceil(middle - half - _HALF), _ZERO)), int(min(np.floor(middle + half - _HALF), _F(columns - 1)))


@compiled
def quick_exp(x: Number) -> Number:
    """e^x for x in [−80, 88] to two units in the last place, as arithmetic that vectorises (Cephes' expf)."""
    biased = np.int32(x * _F(1.44269504) + _F(127.5))  # the nearest power of two, and 127
    whole = _F(biased) - _F(127)
    r = x - whole * _F(0.693359375) + whole * _F(2.12194440e-4)
    p = _F(1.9875691500e-4)
    p = p * r + _F(1.3981999507e-3)
    p = p * r + _F(8.3334519073e-3)
    p = p * r + _F(4.1665795894e-2)
    p = p * r + _F(1.6666665459e-1)
    p = p * r + _F(5.0000001201e-1)
    return (p * r * r + r + _F(1)) * np.int32(biased << np.int32(23)).view(np.float32)


@compiled
def _blend_lanes(
    pixels: NDArray,
    start: Number,
    across: Number,
    alpha_x: Number,
    exponent: Number,
    colour: tuple[Number, Number, Number, Number],
) -> None:
    """Blend one splat into the eight pixels whose planes begin at `start`; free of branches, so that it vectorises."""
    red, green, blue, depth = colour
    for lane in range(LANES):
        at = start + _I(lane)
        u = across + alpha_x * _F(lane)
        alpha = min(quick_exp(max(exponent - u * u, _F(-80))), _ALPHA_MAX)
        before = pixels[at]
        weight = alpha * max(before, _ZERO) if alpha >= _ALPHA_MIN else _ZERO
        after = before - weight
        stops = (after < TRANSMITTANCE_MIN) & (weight > _ZERO)
        weight = _ZERO if stops else weight
        pixels[at] = -before if stops else after
        pixels[at + _RED] += weight * red
        pixels[at + _GREEN] += weight * green
        pixels[at + _BLUE] += weight * blue
        pixels[at + _DEPTH] += weight * depth
