"""Gradients of a photo's error as compiled code: what `kernels_blend.py` draws, walked a second time.

A tile's splats are blended as for a picture, and the tile is held against the photo while it is in the cache. The
second walk goes front to back again: with weight w = α·T, an error's gradient with respect to α is T·⟨colour, ∂⟩ less
what lies behind divided by 1 − α, and what lies behind is what the first walk gathered less what the second has passed.

Each pair of tile and splat has a place of its own for its nine sums, in the order in which pairs are listed;
`kernels_chain.py` makes of them what changes by Gaussian.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .composite import ALPHA_MAX, TRANSMITTANCE_MIN
from .kernels_blend import (
    AHEAD,
    LANES,
    PLANES,
    ROW,
    TILE_WIDTH,
    Extent,
    Listed,
    Scratch,
    blend_tile,
    box,
    bring_near,
    chord,
    quick_exp,
)
from .kernels_project import (
    ALPHA_X,
    AXES,
    BETA_X,
    BLUE,
    CHUNK,
    GAMMA,
    GREEN,
    LAST,
    LOG_OPACITY,
    MEAN,
    OPACITY,
    OWN_PIXEL,
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
"""Sums of a pair of tile and splat."""

PULL, PULL_U, PULL_W, PULL_UU, PULL_UW, PULL_WW, BY_RED, BY_GREEN, BY_BLUE = range(PAIR)
"""Which they are: pull, pull·u, pull·w, pull·u², pull·u·w, pull·w², and weight by colour's gradient (3), where u and w
are whitened pixels and pull is the gradient with respect to the exponent."""

SUMS = 5
"""Of a tile. Pixels whose red is NaN count nowhere and have no gradient."""

ABSOLUTE, SQUARED, BY_GAIN, BY_OFFSET, KNOWN = range(SUMS)
"""Which they are: |error|, squared error of values clipped to [0, 1], sign·picture, sign, and number of pixels."""

_F, _I = np.float32, np.uint64
_STRIDE = TILE_WIDTH + LANES
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
                geometry[chunk, MEAN + axis, lane] = _F(centre[axis] + away * base[chunk, axis, lane])
            for entry in range(9):
                geometry[chunk, AXES + entry, lane] = grown * base[chunk, 3 + entry, lane]
            geometry[chunk, OWN_PIXEL, lane] = _F(away * base[chunk, 12, lane])
            logit = np.float64(values[LOGIT, row])
            # log of the sigmoid, without its overflow
            geometry[chunk, OPACITY, lane] = _F(min(logit, 0.0) - math.log1p(math.exp(-abs(logit))))
            for channel in range(3):
                sh[chunk, channel * CHUNK + lane] = values[SH_RED + channel, row]


class Exposure(NamedTuple):
    """Gain and offset that a picture is seen with, and what a unit of |error| counts; float32."""

    gain: np.float32
    offset: np.float32
    weight: np.float32


class Sought(NamedTuple):
    """What a picture is held against, and what it leaves.

    Attributes:
        photo: (H, W, 3) float32, NaN where nothing is known.
        exposure: how the picture is seen.
        shown: (H, W, 4) float32 or (0, 0, 0): the picture and its transmittance, written in tiles where the photo knows
            something.
        most_left: where transmittance is more, nothing is known either; 1 where `shown` is (0, 0, 0).
        hidden: transmittance before a splat, at its middle, below which its sums are left out; at 0, none are.
    """

    photo: NDArray
    exposure: Exposure
    shown: NDArray
    most_left: np.float32 = np.float32(1)
    hidden: np.float32 = np.float32(0)


@compiled
def measure_tile(
    records: NDArray, rows: NDArray, listed: Listed, extent: Extent, work: Scratch, sought: Sought, has_front: bool,
    sums: NDArray, pairs: NDArray,
) -> None:  # fmt: skip
    """Draw a tile, hold it against the photo, and walk its splats again for their sums.

    Args:
        records, rows, listed, extent, work, has_front: as `kernels_blend.blend_tile` has them.
        sought: the photo.
        sums: (5,) float64, written.
        pairs: (pairs, 9) float32, written at the tile's places; (0, 9) where none are wanted.
    """
    state, near = work.state, work.near
    if not _is_known(sought.photo, extent):
        sums[:] = 0
        if pairs.size:
            for key in listed.keys:
                pairs[key & _I(0xFFFFFFFF)] = 0
        return
    keys, count = blend_tile(records, rows, listed, extent, work, has_front)
    _compare(state, sought, extent, sums)
    if not pairs.size:
        return
    for key in keys:
        pairs[key & _I(0xFFFFFFFF)] = 0
    for is_whole in range(1 - has_front, 2):
        for start in range(0, count, AHEAD):
            end = min(start + AHEAD, count)
            bring_near(records, rows, keys[start:end], near)
            for entry in range(end - start):
                share = _ONE if is_whole else near[entry, LAST]
                if share > _ZERO and not _is_hidden(near[entry], extent, state, sought.hidden):
                    pair = keys[start + entry] & _I(0xFFFFFFFF)
                    _walk(near[entry], share, extent, state, pairs[pair])
        if not is_whole:
            _go_behind(state, extent)


@compiled
def _is_known(photo: NDArray, extent: Extent) -> bool:
    """Whether a photo knows any pixel of a tile."""
    for line in range(extent.rows):
        for lane in range(extent.columns):
            if not np.isnan(photo[extent.row + line, extent.column + lane, 0]):
                return True
    return False


@compiled
def _is_hidden(splat: NDArray, extent: Extent, state: NDArray, hidden: Number) -> bool:
    """Whether what lies before a splat leaves less than that at its middle, or at what is nearest to it of the tile."""
    column = min(max(int(splat[X]) - extent.column, 0), extent.columns - 1)
    row = min(max(int(splat[Y]) - extent.row, 0), extent.rows - 1)
    return max(state[row * ROW + column], _ZERO) < hidden


@compiled
def _go_behind(state: NDArray, extent: Extent) -> None:
    """From the picture in front to that of everything, of which the first lets a part through."""
    for line in range(extent.rows):
        for lane in range(extent.columns):
            at = _I(line * ROW + lane)
            through = abs(state[at])
            state[at] = _ONE
            for plane in (_RED, _GREEN, _BLUE):
                state[at + plane] *= through


@compiled
def _compare(state: NDArray, sought: Sought, extent: Extent, sums: NDArray) -> None:
    """Sum a tile's errors, and turn its state into that of the second walk: full transmittance, the error's gradient by
    colour, and what lies behind the first splat.
    """
    row, column, photo, shown = extent.row, extent.column, sought.photo, sought.shown
    gain, offset, weight = sought.exposure
    sums[:] = 0
    for line in range(extent.rows):
        for lane in range(extent.columns):
            at = line * ROW + lane
            is_known, behind = not np.isnan(photo[row + line, column + lane, 0]), _ZERO
            if shown.size:
                shown[row + line, column + lane, 3] = abs(state[at])
                for channel in range(3):
                    shown[row + line, column + lane, channel] = state[at + (1 + channel) * _STRIDE]
                is_known &= abs(state[at]) <= sought.most_left
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
                sums[ABSOLUTE] += abs(error)
                sums[SQUARED] += clipped * clipped
                sums[BY_GAIN] += sign * found
                sums[BY_OFFSET] += sign
                state[plane] = _F(sign) * gain * weight
                behind += state[plane] * found
            sums[KNOWN] += is_known
            state[at], state[at + 4 * _STRIDE] = _ONE, behind


@summing
def _walk(splat: NDArray, share: Number, extent: Extent, state: NDArray, out: NDArray) -> None:
    """Add the sums of a splat's share over a tile; visits the pixels that `kernels_blend.blend_splat` visits."""
    x, y, alpha_x, beta_x, gamma = splat[X] - _F(extent.column), splat[Y], splat[ALPHA_X], splat[BETA_X], splat[GAMMA]
    log_opacity, reach = splat[LOG_OPACITY], splat[REACH]
    red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
    tau = log_opacity - _LOG_ALPHA_MIN
    left, right, top, bottom = box(splat, extent)
    pull = pull_u = pull_w = pull_uu = pull_uw = pull_ww = g_red = g_green = g_blue = _ZERO
    for row in range(top, bottom + 1):
        dy = _F(row) + _HALF - y
        w = gamma * dy
        fall = w * w
        if reach > _ZERO:
            if fall > tau:
                continue
            left, right = chord(x - beta_x * dy * reach, math.sqrt(tau - fall) * reach, extent.columns)
        start = _I((row - extent.row) * ROW)
        for column in range(left, right + 1, LANES):
            across = alpha_x * (_F(column) + _HALF - x) + beta_x * dy
            exponent = log_opacity - fall
            s_0 = s_u = s_uu = s_red = s_green = s_blue = _ZERO
            for lane in range(LANES):
                at = start + _I(column) + _I(lane)
                u = across + alpha_x * _F(lane)
                full = quick_exp(max(exponent - u * u, _F(-80)))
                alpha = share * min(full, _ALPHA_MAX) if full >= _ALPHA_MIN else _ZERO
                before = state[at]
                opened = max(before, _ZERO)
                weight = alpha * opened
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
    out[PULL] += pull
    out[PULL_U] += pull_u
    out[PULL_W] += pull_w
    out[PULL_UU] += pull_uu
    out[PULL_UW] += pull_uw
    out[PULL_WW] += pull_ww
    out[BY_RED] += g_red
    out[BY_GREEN] += g_green
    out[BY_BLUE] += g_blue
