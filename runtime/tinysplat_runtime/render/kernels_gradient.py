"""Gradients of a photo's error as compiled code: what `kernels_blend.py` draws, walked a second time.

A tile's splats are blended as for a picture, and the tile is held against the photo while it is in the cache. The
second walk goes front to back again: with weight w = α·T, an error's gradient with respect to α is T·⟨colour, ∂⟩ less
what lies behind divided by 1 − α, and what lies behind is what the first walk gathered less what the second has passed.

Each pair of tile and splat has a place of its own for its nine sums, in the order in which pairs are listed;
`kernels_chain.py` makes of them what changes by Gaussian.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .composite import ALPHA_MAX, TRANSMITTANCE_MIN
from .kernels_blend import (
    AHEAD,
    LANES,
    PLANES,
    TILE_HEIGHT,
    TILE_WIDTH,
    blend_splat,
    box,
    chord,
    is_open,
    quick_exp,
    sort_by_depth,
)
from .kernels_project import (
    ALPHA_X,
    BETA_X,
    BLUE,
    CHUNK,
    DEPTH,
    GAMMA,
    GREEN,
    LAST,
    LOG_OPACITY,
    REACH,
    RED,
    Number,
    X,
    Y,
    compiled,
    summing,
)
from .prepare import ALPHA_MIN

VALUES = 6
"""Of a Gaussian: log of its depth against where it began, log of its size likewise, logit of its opacity, and the red,
green and blue coefficient of SH degree 0. Means stay on the rays of their pixels; a Gaussian that moves away grows with
its distance, so that its own camera sees it as large as before."""

LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED, SH_GREEN, SH_BLUE = range(VALUES)

BASE = 13
"""Planes of a chunk of what does not change: ray from the own camera's centre (3), principal axes (9), own pixel."""

PAIR = 9
"""Sums of a pair: pull, pull·u, pull·w, pull·u², pull·u·w, pull·w², and weight by colour's gradient (3), where u and w
are whitened pixels and pull is the gradient with respect to the exponent."""

SUMS = 5
"""Of a tile: |error|, squared error of values clipped to [0, 1], sign·picture, sign, and number of pixels. Pixels whose
red is NaN count nowhere and have no gradient."""

_F, _I = np.float32, np.uint64
_STRIDE = TILE_WIDTH + LANES
_ROW = PLANES * _STRIDE
_RED, _GREEN, _BLUE, _BEHIND = (_I(plane * _STRIDE) for plane in range(1, PLANES))
_ALPHA_MIN, _ALPHA_MAX, _LOG_ALPHA_MIN = _F(ALPHA_MIN), _F(ALPHA_MAX), _F(math.log(ALPHA_MIN))
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)


@compiled
def place(base: NDArray, centre: NDArray, values: NDArray, geometry: NDArray, sh: NDArray) -> None:
    """Put a block's Gaussians where their values say.

    Args:
        base: (chunks, 13, 128) float32.
        centre: (3,) float64, of the own camera, relative to the Gaussians' origin.
        values: (6, chunks·128) float32.
        geometry: (chunks, 14, 128) float32, written; see `kernels_project.project`.
        sh: (chunks, 3 S·128) float32, whose coefficients of degree 0 are written.
    """
    for chunk in range(len(base)):
        for lane in range(CHUNK):
            row = chunk * CHUNK + lane
            away = math.exp(np.float64(values[LOG_DEPTH, row]))
            grown = _F(math.exp(np.float64(values[LOG_DEPTH, row]) + np.float64(values[LOG_SIZE, row])))
            for axis in range(3):
                geometry[chunk, axis, lane] = _F(centre[axis] + away * base[chunk, axis, lane])
            for entry in range(9):
                geometry[chunk, 3 + entry, lane] = grown * base[chunk, 3 + entry, lane]
            geometry[chunk, 13, lane] = _F(away * base[chunk, 12, lane])
            logit = np.float64(values[LOGIT, row])
            # log of the sigmoid, without its overflow
            geometry[chunk, 12, lane] = _F(min(logit, 0.0) - math.log1p(math.exp(-abs(logit))))
            for channel in range(3):
                sh[chunk, channel * CHUNK + lane] = values[SH_RED + channel, row]


@compiled
def list_pairs(
    records: NDArray, ids: NDArray, boxes: NDArray, columns: Number, tiles: tuple[Number, Number], ends: NDArray,
    keys: NDArray, rows: NDArray,
) -> None:  # fmt: skip
    """Append a block's splats to the lists of some tiles.

    Args:
        records: (N, 16), of all blocks.
        ids, boxes: the visible splats, as from `list_visible`.
        columns: tiles in a row of tiles.
        tiles: first, and the one behind the last.
        ends: (tiles,) int64, where each list goes on; moved on.
        keys: uint64: bits of the depth above the pair's place.
        rows: (pairs,) int32, the record of every place.
    """
    for entry in range(ids.size):
        left, right, top, bottom = boxes[entry, 0], boxes[entry, 1], boxes[entry, 2], boxes[entry, 3]
        row = ids[entry]
        depth = _I(_F(records[row, DEPTH]).view(np.uint32)) << _I(32)
        for tile_row in range(max(top, tiles[0] // columns), min(bottom, (tiles[1] - 1) // columns) + 1):
            start = tile_row * columns
            for tile in range(max(start + left, tiles[0]), min(start + right + 1, tiles[1])):
                pair = ends[tile - tiles[0]]
                keys[pair] = depth | _I(pair)
                rows[pair] = row
                ends[tile - tiles[0]] += 1


@compiled
def measure_tile(
    records: NDArray, rows: NDArray, keys: NDArray, scratch: NDArray, corner: tuple[Number, Number],
    workspace: tuple[NDArray, NDArray, NDArray], photo: NDArray, exposure: tuple[Number, Number, Number],
    pairs: NDArray, sums: NDArray, left: NDArray, has_front: bool, with_gradient: bool,
) -> None:  # fmt: skip
    """Draw a tile, hold it against the photo, and walk its splats again for their sums.

    Args:
        records: (N, 16) float32.
        rows: (pairs,) int32, the record of every pair.
        keys: the tile's list, as from `list_pairs`; changed.
        scratch: as long.
        corner: row and column of the tile's first pixel.
        workspace: (`STATE`,) and (`AHEAD`, 16) float32, (`DIGITS`,) int64.
        photo: (H, W, 3) float32, NaN where nothing is known.
        exposure: gain and offset that the picture is seen with, and what a unit of |error| counts.
        pairs: (pairs, 9) float32, written at the tile's places.
        sums: (5,) float64, written.
        left: (H, W) float32 or (0, 0): transmittance, written where the tile lies.
        has_front: whether splats are blended twice, see `kernels_blend.composite_tile`.
        with_gradient: whether to write `pairs`.
    """
    state, near, histogram = workspace
    row, column = corner
    height, width = min(TILE_HEIGHT, len(photo) - row), min(TILE_WIDTH, photo.shape[1] - column)
    state[:] = 0
    for line in range(height):
        state[line * _ROW : line * _ROW + width] = 1
    keys = sort_by_depth(keys, scratch, histogram)
    drawn = 0, 0  # how many of the list were looked at as a share, and as a whole
    for is_whole in range(1 - has_front, 2):
        count = 0
        while count < keys.size and (count == 0 or is_open(state)):
            end = min(count + AHEAD, keys.size)
            _bring_near(records, rows, keys[count:end], is_whole, near)
            for entry in range(end - count):
                if near[entry, LOG_OPACITY] >= _LOG_ALPHA_MIN:
                    blend_splat(near[entry], row, column, height, width, state)
            count = end
        drawn = (drawn[0], count) if is_whole else (count, 0)
    _compare(state, photo, corner, exposure, sums, left)
    if not with_gradient:
        return
    for key in keys:
        pairs[key & _I(0xFFFFFFFF)] = 0
    for is_whole in range(1 - has_front, 2):
        count = drawn[is_whole]
        for start in range(0, count, AHEAD):
            end = min(start + AHEAD, count)
            _bring_near(records, rows, keys[start:end], is_whole, near)
            for entry in range(end - start):
                if near[entry, LOG_OPACITY] >= _LOG_ALPHA_MIN:
                    pair = keys[start + entry] & _I(0xFFFFFFFF)
                    _walk(near[entry], row, column, height, width, state, pairs[pair])


@compiled
def _bring_near(records: NDArray, rows: NDArray, keys: NDArray, is_whole: Number, near: NDArray) -> None:
    """Copy what is to be blended next, with the share of its opacity that is drawn in front or its whole."""
    for entry in range(keys.size):
        near[entry] = records[rows[keys[entry] & _I(0xFFFFFFFF)]]
        if not is_whole:
            near[entry, LOG_OPACITY] += near[entry, LAST]


@compiled
def _compare(
    state: NDArray, photo: NDArray, corner: tuple[Number, Number], exposure: tuple[Number, Number, Number],
    sums: NDArray, left: NDArray,
) -> None:  # fmt: skip
    """Sum a tile's errors, and turn its state into that of the second walk: full transmittance, the error's gradient by
    colour, and what lies behind the first splat.
    """
    row, column = corner
    height, width = min(TILE_HEIGHT, len(photo) - row), min(TILE_WIDTH, photo.shape[1] - column)
    gain, offset, weight = exposure
    sums[:] = 0
    for line in range(height):
        for lane in range(width):
            at = line * _ROW + lane
            is_known, behind = not np.isnan(photo[row + line, column + lane, 0]), _ZERO
            if left.size:
                left[row + line, column + lane] = abs(state[at])
            for channel in range(3):
                plane = at + (1 + channel) * _STRIDE
                found, wanted = state[plane], photo[row + line, column + lane, channel]
                if not is_known:
                    state[plane] = _ZERO
                    continue
                seen = gain * found + offset
                error = np.float64(seen - wanted)
                clipped = np.float64(min(max(seen, _ZERO), _ONE) - wanted)
                sign = 1.0 if error > 0 else (-1.0 if error < 0 else 0.0)
                sums[0] += abs(error)
                sums[1] += clipped * clipped
                sums[2] += sign * found
                sums[3] += sign
                state[plane] = _F(sign) * gain * weight
                behind += state[plane] * found
            sums[4] += is_known
            state[at], state[at + 4 * _STRIDE] = _ONE, behind


@summing
def _walk(
    splat: NDArray, first_row: Number, first_column: Number, rows: Number, columns: Number, state: NDArray, out: NDArray
) -> None:
    """Add a splat's sums over a tile; visits the pixels that `kernels_blend.blend_splat` visits."""
    x, y, alpha_x, beta_x, gamma = splat[X] - _F(first_column), splat[Y], splat[ALPHA_X], splat[BETA_X], splat[GAMMA]
    log_opacity, reach = splat[LOG_OPACITY], splat[REACH]
    red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
    tau = log_opacity - _LOG_ALPHA_MIN
    left, right, top, bottom = box(splat, first_row, first_column, rows, columns)
    pull = pull_u = pull_w = pull_uu = pull_uw = pull_ww = g_red = g_green = g_blue = _ZERO
    for row in range(top, bottom + 1):
        dy = _F(row) + _HALF - y
        w = gamma * dy
        fall = w * w
        if reach > _ZERO:
            if fall > tau:
                continue
            left, right = chord(x - beta_x * dy * reach, math.sqrt(tau - fall) * reach, columns)
        start = _I((row - first_row) * _ROW)
        for column in range(left, right + 1, LANES):
            across = alpha_x * (_F(column) + _HALF - x) + beta_x * dy
            exponent = log_opacity - fall
            s_0 = s_u = s_uu = s_red = s_green = s_blue = _ZERO
            for lane in range(LANES):
                at = start + _I(column) + _I(lane)
                u = across + alpha_x * _F(lane)
                full = quick_exp(max(exponent - u * u, _F(-80)))
                alpha = min(full, _ALPHA_MAX)
                before = state[at]
                opened = max(before, _ZERO)
                weight = alpha * opened if alpha >= _ALPHA_MIN else _ZERO
                after = before - weight
                stops = (after < TRANSMITTANCE_MIN) & (weight > _ZERO)
                weight = _ZERO if stops else weight
                state[at] = -before if stops else after
                d_red, d_green, d_blue = state[at + _RED], state[at + _GREEN], state[at + _BLUE]
                along = red * d_red + green * d_green + blue * d_blue
                behind = state[at + _BEHIND] - weight * along
                state[at + _BEHIND] = behind
                pulled = alpha * (opened * along - behind / (_ONE - alpha))
                pulled = pulled if (weight > _ZERO) & (full <= _ALPHA_MAX) else _ZERO
                s_0 += pulled
                s_u += pulled * u
                s_uu += pulled * u * u
                s_red += weight * d_red
                s_green += weight * d_green
                s_blue += weight * d_blue
            pull += s_0
            pull_u += s_u
            pull_w += s_0 * w
            pull_uu += s_uu
            pull_uw += s_u * w
            pull_ww += s_0 * fall
            g_red += s_red
            g_green += s_green
            g_blue += s_blue
    out[0] += pull
    out[1] += pull_u
    out[2] += pull_w
    out[3] += pull_uu
    out[4] += pull_uw
    out[5] += pull_ww
    out[6] += g_red
    out[7] += g_green
    out[8] += g_blue
