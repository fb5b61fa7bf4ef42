"""Gradients of a photo's error as compiled code: what `kernels_blend.py` draws, walked a second time.

A tile's splats are blended as for a picture, and the tile is held against the photo while it is in the cache. The
second walk goes front to back again: with weight w = α·T, an error's gradient with respect to α is T·⟨colour, ∂⟩ less
what lies behind divided by 1 − α, and what lies behind is what the first walk gathered less what the second has passed.

Each pair of tile and splat has a place of its own for its nine sums, in the order in which pairs are listed. Adding
them up by Gaussian replays that listing, so results depend on neither the number of threads nor their haste. The chain
from sums to values needs no derivative of a covariance: in whitened pixels y = F·d with exponent −|y|² (F has αx, βx
and γ), Σ₂ enters as 2 tr(F dΣ₂ Fᵀ Σ pull·y·yᵀ), which needles do not cancel. What turns with the direction that colours
of SH degree 1 and up are seen from is left out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from .composite import ALPHA_MAX, TRANSMITTANCE_MIN
from .kernels_blend import (
    AHEAD,
    LANES,
    PLANES,
    TILE_HEIGHT,
    TILE_WIDTH,
    blend_splat,
    is_open,
    quick_exp,
    sort_by_depth,
)
from .kernels_project import (
    ALPHA_X,
    BETA_X,
    BLUE,
    BOTTOM,
    CHUNK,
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
    summing,
)
from .prepare import ALPHA_MIN
from .project import DILATION, LEAST_OWN_PIXEL, LEAST_VARIANCE, MARGIN_PX

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
_ZERO, _ONE, _HALF, _MARGIN = _F(0), _F(1), _F(0.5), _F(MARGIN_PX)


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
    left, right = max(int(splat[LEFT]) - first_column, 0), min(int(splat[RIGHT]) - first_column, columns - 1)
    top, bottom = max(int(splat[TOP]), first_row), min(int(splat[BOTTOM]), first_row + rows - 1)
    pull = pull_u = pull_w = pull_uu = pull_uw = pull_ww = g_red = g_green = g_blue = _ZERO
    for row in range(top, bottom + 1):
        dy = _F(row) + _HALF - y
        w = gamma * dy
        fall = w * w
        if reach > _ZERO:
            if fall > tau:
                continue
            middle, half = x - beta_x * dy * reach, math.sqrt(tau - fall) * reach + _MARGIN
            left = int(max(np.ceil(middle - half - _HALF), _ZERO))
            right = int(min(np.floor(middle + half - _HALF), _F(columns - 1)))
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


@compiled
def add_up(
    records: NDArray, ids: NDArray, boxes: NDArray, columns: Number, tiles: tuple[Number, Number], ends: NDArray,
    pairs: NDArray, place_of: tuple[Number, NDArray, NDArray, NDArray], view: NDArray, gradient: NDArray,
) -> None:  # fmt: skip
    """Add a block's gradients with respect to its values, of one photo.

    Args:
        records, ids, boxes, columns, tiles: as `list_pairs` was given them.
        ends: (tiles,) int64, where each list began; moved on.
        pairs: (pairs, 9) float32.
        place_of: first row of the block, its geometry (chunks, 14, 128), the own camera's centre (3,), and its values.
        view: (22,) float64, as `kernels_project.project` takes it.
        gradient: (6, rows) float32 of the block, added to.
    """
    first, geometry, centre, values = place_of
    total = np.empty(PAIR, np.float64)
    for entry in range(ids.size):
        left, right, top, bottom = boxes[entry, 0], boxes[entry, 1], boxes[entry, 2], boxes[entry, 3]
        total[:] = 0
        for tile_row in range(max(top, tiles[0] // columns), min(bottom, (tiles[1] - 1) // columns) + 1):
            start = tile_row * columns
            for tile in range(max(start + left, tiles[0]), min(start + right + 1, tiles[1])):
                pair = ends[tile - tiles[0]]
                for number in range(PAIR):
                    total[number] += pairs[pair, number]
                ends[tile - tiles[0]] += 1
        record = records[ids[entry]]
        row = ids[entry] - first
        along_depth, along_size = _shape_gradient(record, geometry[row // CHUNK], row % CHUNK, centre, view, total)
        gradient[LOG_DEPTH, row] += _F(along_depth)
        gradient[LOG_SIZE, row] += _F(along_size)
        gradient[LOGIT, row] += _F(total[0] / (1 + math.exp(np.float64(values[LOGIT, row]))))  # 1 − opacity
        for channel in range(3):
            if record[RED + channel] > _ZERO:
                gradient[SH_RED + channel, row] += _F(C0 * total[6 + channel])


@compiled
def _shape_gradient(
    record: NDArray, geometry: NDArray, lane: Number, centre: NDArray, view: NDArray, total: NDArray
) -> tuple[Number, Number]:
    """Gradients with respect to log depth, along the own camera's ray, and log size."""
    x, y, z = np.float64(geometry[0, lane]), np.float64(geometry[1, lane]), np.float64(geometry[2, lane])
    ray_x, ray_y, ray_z = x - centre[0], y - centre[1], z - centre[2]
    x, y, z = x + view[0], y + view[1], z + view[2]
    scale = 1 / (view[15] * x + view[16] * y + view[17] * z)
    # Pixel of the mean and its change, both from the principal point
    u, v = (view[9] * x + view[10] * y + view[11] * z) * scale, (view[12] * x + view[13] * y + view[14] * z) * scale
    deeper = (view[15] * ray_x + view[16] * ray_y + view[17] * ray_z) * scale  # relative change of depth
    du = (view[9] * ray_x + view[10] * ray_y + view[11] * ray_z) * scale - u * deeper
    dv = (view[12] * ray_x + view[13] * ray_y + view[14] * ray_z) * scale - v * deeper
    ju, jv = min(max(u, view[5]), view[7]), min(max(v, view[6]), view[8])
    dju, djv = du if ju == u else 0.0, dv if jv == v else 0.0
    # Rows m and n of J·W·axes; with the ray, axes grow too, which undoes the Jacobian's fall by depth in part
    aa = ab = bb = a_da = ab_d = b_db = 0.0
    for axis in range(3):
        p = q = r = 0.0
        for entry in range(3):
            length = np.float64(geometry[3 + 3 * entry + axis, lane])
            p += view[9 + entry] * length
            q += view[12 + entry] * length
            r += view[15 + entry] * length
        m, n = (p - ju * r) * scale, (q - jv * r) * scale
        dm, dn = m * (1 - deeper) - dju * r * scale, n * (1 - deeper) - djv * r * scale
        aa += m * m
        ab += m * n
        bb += n * n
        a_da += m * dm
        ab_d += m * dn + n * dm
        b_db += n * dn
    f, g, h = np.float64(record[ALPHA_X]), np.float64(record[BETA_X]), np.float64(record[GAMMA])
    # 2 tr(F dΣ Fᵀ Q) as factors of da, db and dc
    by_a = 2 * f * f * total[3]
    by_b = 4 * f * g * total[3] + 4 * f * h * total[4]
    by_c = 2 * g * g * total[3] + 4 * g * h * total[4] + 2 * h * h * total[5]
    by_u, by_v = 2 * f * total[1], 2 * (g * total[1] + h * total[2])
    along_depth = by_u * du + by_v * dv + 2 * a_da * by_a + ab_d * by_b + 2 * b_db * by_c
    along_size = 2 * (aa * by_a + ab * by_b + bb * by_c)
    own = np.float64(geometry[13, lane]) * view[21] * scale
    covariance, change = (aa, ab, bb), (2 * a_da, ab_d, 2 * b_db)
    if own > 1:
        wider, wider_size = _widening(own, 1 - deeper, covariance, change)
        along_depth += wider * (by_a + by_c)
        along_size += wider_size * (by_a + by_c)
    elif own > 0:
        faded, faded_size = _fading(own, 1 - deeper, covariance, change)
        along_depth += faded * total[0]
        along_size += faded_size * total[0]
    return along_depth, along_size


@compiled
def _widening(
    own: Number, wider: Number, covariance: tuple[Number, Number, Number], change: tuple[Number, Number, Number]
) -> tuple[Number, Number]:
    """Change of the dilation by log depth and by log size; arguments as those of `_fading`, but `own` above 1."""
    a, b, c = covariance
    da, db, dc = change
    apart = math.sqrt((a - c) * (a - c) + 4 * b * b)
    least = (a * c - b * b) / max(0.5 * (a + c + apart), LEAST_VARIANCE)
    e = DILATION * own * own
    if e - least <= DILATION:
        return 0.0, 0.0
    turned = ((a - c) * (da - dc) + 4 * b * db) / apart if apart > 0 else 0.0
    return 2 * e * wider - 0.5 * (da + dc - turned), -2 * least


@compiled
def _fading(
    own: Number, wider: Number, covariance: tuple[Number, Number, Number], change: tuple[Number, Number, Number]
) -> tuple[Number, Number]:
    """Change, by log depth and by log size, of the logarithm of the opacity that `kernels_project._shapes` leaves.

    Args:
        own: own pixel on the screen, at most 1.
        wider: its relative change with log depth.
        covariance: (a, b, c) of the footprint before dilation.
        change: theirs with log depth.
    """
    a, b, c = covariance
    da, db, dc = change
    cross, dcross = a * c - b * b, da * c + a * dc - 2 * b * db
    along_depth = along_size = 0.0
    for half in (0.5, -0.5):
        wide = own if half > 0 else 1.0
        e = DILATION * max(wide, LEAST_OWN_PIXEL) ** 2
        de = 2 * e * wider if half > 0 and own > LEAST_OWN_PIXEL else 0.0
        det = e * (a + c + e) + cross
        along_depth += half * (de * (a + c + 2 * e) + e * (da + dc) + dcross) / det
        along_size += half * (2 * e * (a + c) + 4 * cross) / det
    return along_depth, along_size
