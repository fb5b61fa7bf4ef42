"""Depth order and compositing as compiled code: the definition of `composite.py`, a tile of pixels at a time.

A tile's splats are sorted by depth and blended one row of one splat at a time, eight pixels to a vector instruction.
Where numpy needs lists of splats of every 4×4 pixels to have long arrays, a loop needs none: a tile is as large as a
core's L2 cache likes.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..system.kernels_compile import Number, compiled, within
from ..system.kernels_lanes import LANES, halves, least, load, most, ramp, store, where
from .composite import ALPHA_MAX, TRANSMITTANCE_MIN
from .kernels_list import TILE_HEIGHT, TILE_WIDTH, Listed, sort_by_depth
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
    RECORD,
    RED,
    RIGHT,
    TOP,
    X,
    Y,
)
from .prepare import ALPHA_MIN
from .project import MARGIN_PX

PLANES = 5
"""What a pixel gathers: transmittance, negative once it has stopped; red, green, blue; Σ w·z."""

_F, _I = np.float32, np.uint64
_STRIDE = TILE_WIDTH + LANES  # a vector may begin at any pixel, so that it may end beyond the tile
ROW = 2 * PLANES * _STRIDE
"""Floats of a row of a tile: of the picture of everything, and of the one in front of it."""

STATE = TILE_HEIGHT * ROW
_RED, _GREEN, _BLUE, _DEPTH = (_I(plane * _STRIDE) for plane in range(1, PLANES))
_FRONT = _I(PLANES * _STRIDE)
_ALPHA_MIN, _ALPHA_MAX, _LOG_ALPHA_MIN = _F(ALPHA_MIN), _F(ALPHA_MAX), _F(math.log(ALPHA_MIN))
_HALF, _MARGIN, _ZERO, _TRANSMITTANCE_MIN = _F(0.5), _F(MARGIN_PX), _F(0), _F(TRANSMITTANCE_MIN)

AHEAD = 256
"""Splats whose records are brought near before they are blended: the misses of a loop that only copies overlap, which
those of blending do not (1.8 of 15.5 ms for 131,072 Gaussians). After each batch a tile without an open pixel is done.
"""


class Extent(NamedTuple):
    """A tile's first row and column of pixels, and how many of each it has within the picture."""

    row: int
    column: int
    rows: int
    columns: int


class Scratch(NamedTuple):
    """A thread's: (`STATE`,) and (`AHEAD`, 16) float32, (`DIGITS`,) int64."""

    state: NDArray
    near: NDArray
    histogram: NDArray


class Picture(NamedTuple):
    """(H, W, 3), (H, W) and (H, W) float32; depth is (0, 0) where none is gathered."""

    colour: NDArray
    left: NDArray
    depth: NDArray


@compiled
def composite_tile(listed: Listed, extent: Extent, work: Scratch, picture: Picture, has_front: bool) -> None:
    """Blend a tile's splats into the picture, where the tile lies; arguments as `blend_tile` has them."""
    state = work.state
    blend_tile(listed, extent, work, has_front)
    for line in range(extent.rows):
        for lane in range(extent.columns):
            at, row, column = line * ROW + lane, extent.row + line, extent.column + lane
            picture.left[row, column] = abs(state[at])
            for channel in range(3):
                picture.colour[row, column, channel] = state[at + (1 + channel) * _STRIDE]
            if picture.depth.size:
                picture.depth[row, column] = state[at + 4 * _STRIDE]


@within
def blend_tile(listed: Listed, extent: Extent, work: Scratch, has_front: bool) -> tuple[NDArray, Number]:
    """Blend a tile's splats in its state.

    Args:
        listed: the tile's list.
        extent: where it lies.
        work: the thread's.
        has_front: whether a second picture, of shares of splats' alphas, the last numbers of their records, comes
            before that of everything. Both are made in one walk, as most of what a splat takes, it takes once.

    Returns:
        The sorted list, and how many of it were looked at.
    """
    state, near = work.state, work.near
    _clear(state, extent)
    keys = sort_by_depth(listed.keys, listed.scratch, work.histogram)
    count = 0
    while count < keys.size and (count == 0 or is_open(state) or (has_front and is_open(state[_FRONT:]))):
        end = min(count + AHEAD, keys.size)
        bring_near(listed, keys[count:end], near)
        for entry in range(end - count):
            blend_splat(near[entry], extent, state, has_front and near[entry, LAST] > _ZERO)
        count = end
    if has_front:
        _put_together(state, extent)
    return keys, count


@within
def _put_together(state: NDArray, extent: Extent) -> None:
    """Put the picture in front before that of everything."""
    for line in range(extent.rows):
        for lane in range(extent.columns):
            at = _I(line * ROW + lane)
            through = abs(state[at + _FRONT])
            state[at] = through * abs(state[at])
            for plane in (_RED, _GREEN, _BLUE, _DEPTH):
                state[at + plane] = state[at + plane + _FRONT] + through * state[at + plane]


@within
def _clear(state: NDArray, extent: Extent) -> None:
    """A tile that nothing is drawn in."""
    state[:] = 0
    for line in range(extent.rows):
        for start in (line * ROW, line * ROW + int(_FRONT)):
            state[start : start + extent.columns] = 1


@within
def bring_near(listed: Listed, keys: NDArray, near: NDArray) -> None:
    """Copy the records (n, 16) float32 that are blended next to `near`."""
    records, rows = listed.records, listed.rows
    for entry in range(keys.size):
        row = _I(rows[keys[entry] & _I(0xFFFFFFFF)])
        for column in range(RECORD):  # an assignment of rows would take two seconds to compile, for its errors' words
            near[_I(entry), _I(column)] = records[row, _I(column)]


@within
def is_open(state: NDArray) -> bool:
    """Whether any pixel of a tile, `state` (STATE,) float32, still lets something through."""
    for row in range(TILE_HEIGHT):
        for column in range(TILE_WIDTH):
            if state[row * ROW + column] > _ZERO:
                return True
    return False


@within
def blend_splat(splat: NDArray, extent: Extent, state: NDArray, in_front: bool) -> None:
    """Blend one splat, a record (16,) float32, into a tile (STATE,), and its share into the picture in front."""
    x, y, alpha_x, beta_x, gamma = splat[X] - _F(extent.column), splat[Y], splat[ALPHA_X], splat[BETA_X], splat[GAMMA]
    log_opacity = splat[LOG_OPACITY]
    colour, step = (splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH]), ramp() * alpha_x
    (left, right, top, bottom), is_wide = box(splat, extent), splat[REACH] > _ZERO
    for row in range(top, bottom + 1):
        dy = _F(row) + _HALF - y
        fall = gamma * dy * (gamma * dy)
        first, last = columns_in(splat, extent, dy) if is_wide else (left, right)
        start = _I((row - extent.row) * ROW)
        for column in range(first, last + 1, LANES):
            at, u = start + _I(column), step + (alpha_x * (_F(column) + _HALF - x) + beta_x * dy)
            alpha = cut(alphas(u, log_opacity - fall))
            _blend_pixels(state, at, alpha, colour)
            if in_front:
                _blend_pixels(state, at + _FRONT, alpha * splat[LAST], colour)


@within
def box(splat: NDArray, extent: Extent) -> tuple[Number, Number, Number, Number]:
    """First and last column of a tile that a splat (16,) float32 may reach, and first and last row of the picture."""
    return (
        max(int(splat[LEFT]) - extent.column, 0),
        min(int(splat[RIGHT]) - extent.column, extent.columns - 1),
        max(int(splat[TOP]), extent.row),
        min(int(splat[BOTTOM]), extent.row + extent.rows - 1),
    )


@within
def columns_in(splat: NDArray, extent: Extent, dy: Number) -> tuple[Number, Number]:
    """First and last column of a tile that a wide splat, with `REACH`, may reach in a row `dy` below its middle: the
    ends of its chord, and a little around it.
    """
    reach, w, tau = splat[REACH], splat[GAMMA] * dy, splat[LOG_OPACITY] - _LOG_ALPHA_MIN
    fall = w * w
    if fall > tau:
        return 0, -1
    middle = splat[X] - _F(extent.column) - splat[BETA_X] * dy * reach
    half = math.sqrt(tau - fall) * reach + _MARGIN
    first, last = np.ceil(middle - half - _HALF), np.floor(middle + half - _HALF)
    return int(max(first, _ZERO)), int(min(last, _F(extent.columns - 1)))


@within
def alphas(u: Number, exponent: Number) -> Number:
    """Alphas of a splat, before they are cut, where its exponent in the middle of the row is so large and `u` away.

    e^x for x in [−80, 88] to two units in the last place (Cephes' expf).
    """
    x = most(exponent - u * u, _F(-80))
    nearest, power = halves(x * _F(1.44269504) + _F(127.5))  # of two, and 127
    whole = nearest - _F(127)
    r = x - whole * _F(0.693359375) + whole * _F(2.12194440e-4)
    p = r * _F(1.9875691500e-4) + _F(1.3981999507e-3)
    p = p * r + _F(8.3334519073e-3)
    p = p * r + _F(4.1665795894e-2)
    p = p * r + _F(1.6666665459e-1)
    p = p * r + _F(5.0000001201e-1)
    return (p * r * r + r + _F(1)) * power


@within
def cut(full: Number) -> Number:
    """Alphas as they are blended."""
    return where(full >= _ALPHA_MIN, least(full, _ALPHA_MAX), _ZERO)


@within
def blend(before: Number, alpha: Number) -> tuple[Number, Number]:
    """The rule of blending: an alpha's weight in a pixel, and the transmittance that it leaves of `before`.

    A pixel whose transmittance would come under the least there is stops instead: from then on it is negative.
    """
    weight = alpha * most(before, _ZERO)
    after = before - weight
    stops = (after < _TRANSMITTANCE_MIN) & (weight > _ZERO)
    return where(stops, _ZERO, weight), where(stops, _ZERO - before, after)


Colour = tuple[Number, Number, Number, Number]  # and depth


@within
def _blend_pixels(pixels: NDArray, at: Number, alpha: Number, colour: Colour) -> None:
    """Blend alphas into the eight pixels whose planes begin at `at`."""
    red, green, blue, depth = colour
    weight, after = blend(load(pixels, at), alpha)
    store(pixels, at, after)
    store(pixels, at + _RED, load(pixels, at + _RED) + weight * red)
    store(pixels, at + _GREEN, load(pixels, at + _GREEN) + weight * green)
    store(pixels, at + _BLUE, load(pixels, at + _BLUE) + weight * blue)
    store(pixels, at + _DEPTH, load(pixels, at + _DEPTH) + weight * depth)
