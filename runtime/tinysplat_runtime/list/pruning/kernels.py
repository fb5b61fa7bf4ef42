"""What every Gaussian does to a picture, as compiled code: what its removal would change, and what its colour should.

A pixel is linear in each α. Without splat i it is C + ΔC with ΔC = −α ∂C/∂α = α/(1 − α)·(R − T·c), T what comes through
to it, c its colour, R what it and all behind it add; its square is what one removal costs (POTR, arXiv 2601.14821).
Opacity counts as a fourth colour, so that nothing is left out for being as black as the background; of it, R − T·c is
what the pixel lets through in the end.

A tile is blended as for a picture, and its state is walked again front to back; each pair of tile and splat has a
place of its own for its sums (`kernels_list.list_by_tile`), so that results do not depend on threads.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ...render.kernels_blend import (
    AHEAD,
    ROW,
    Extent,
    Scratch,
    alphas,
    blend,
    blend_tile,
    box,
    bring_near,
    columns_in,
    cut,
)
from ...render.kernels_list import TILE_WIDTH, Listed, Tiles, Visible, rows_of, tiles_of
from ...render.kernels_project import ALPHA_X, BETA_X, BLUE, GAMMA, GREEN, LOG_OPACITY, REACH, RED, X, Y
from ...system.kernels_compile import Number, compiled, within
from ...system.kernels_lanes import LANES, lanes, load, ramp, store, total, where

OPACITY_COLOUR = 0.5
"""Opacity counts as a fourth colour that is so bright."""

SUMS = 5
"""Of a pair: Σ |ΔC|²; Σ w·(wanted − C) of three colours; Σ w·(all weights of the pixel), which bounds what colours
change together."""

COST, LACK, BOUND = 0, 1, 4

_F, _I = np.float32, np.uint64
_STRIDE = TILE_WIDTH + LANES
_RED, _GREEN, _BLUE, _LEFT, _LACK_RED, _LACK_GREEN, _LACK_BLUE = (_I(plane * _STRIDE) for plane in range(1, 8))
"""Planes of the second walk behind transmittance: R by colour; what the pixel lets through; wanted − C by colour."""

_ZERO, _ONE, _HALF, _OPACITY = _F(0), _F(1), _F(0.5), _F(OPACITY_COLOUR**2)


@compiled
def score_tile(listed: Listed, extent: Extent, work: Scratch, wanted: NDArray, is_first: bool, pairs: NDArray) -> None:
    """Draw a tile and fill the sums of its splats.

    Args:
        listed, extent, work: as `kernels_blend.blend_tile` has them.
        wanted: (H, W, 3) float32: the picture that is wanted.
        is_first: the picture as drawn is what is wanted; `wanted` is written.
        pairs: (pairs, 5) float32, written at the tile's places.
    """
    keys, count = blend_tile(listed, extent, work, np.bool_(False))  # a literal would compile it again
    _turn_over(work.state, wanted, extent, is_first)
    for key in keys[count:]:
        pairs[key & _I(0xFFFFFFFF)] = 0
    for start in range(0, count, AHEAD):
        end = min(start + AHEAD, count)
        bring_near(listed, keys[start:end], work.near)
        for entry in range(end - start):
            _walk(work.near[entry], extent, work.state, pairs[keys[start + entry] & _I(0xFFFFFFFF)])


@within
def _turn_over(state: NDArray, wanted: NDArray, extent: Extent, is_first: bool) -> None:
    """From a drawn tile to what its second walk begins with."""
    for line in range(extent.rows):
        for lane in range(extent.columns):
            at = line * ROW + lane
            state[at + 4 * _STRIDE], state[at] = abs(state[at]), _ONE
            for channel in range(3):
                found = state[at + (1 + channel) * _STRIDE]
                if is_first:
                    wanted[extent.row + line, extent.column + lane, channel] = found
                aim = wanted[extent.row + line, extent.column + lane, channel]
                state[at + (5 + channel) * _STRIDE] = aim - found


@within
def _walk(splat: NDArray, extent: Extent, state: NDArray, out: NDArray) -> None:
    """Write a splat's sums over a tile; visits the pixels that `kernels_blend.blend_splat` visits."""
    x, y, alpha_x, beta_x, gamma = splat[X] - _F(extent.column), splat[Y], splat[ALPHA_X], splat[BETA_X], splat[GAMMA]
    log_opacity, step = splat[LOG_OPACITY], ramp() * alpha_x
    red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
    (left, right, top, bottom), is_wide = box(splat, extent), splat[REACH] > _ZERO
    cost = lack_red = lack_green = lack_blue = bound = lanes(_ZERO)
    for row in range(top, bottom + 1):
        dy = _F(row) + _HALF - y
        w = gamma * dy
        first, last = columns_in(splat, extent, dy) if is_wide else (left, right)
        start = _I((row - extent.row) * ROW)
        for column in range(first, last + 1, LANES):
            at, u = start + _I(column), step + (alpha_x * (_F(column) + _HALF - x) + beta_x * dy)
            alpha = cut(alphas(u, log_opacity - w * w))
            before, left_over = load(state, at), load(state, at + _LEFT)
            weight, after = blend(before, alpha)
            store(state, at, after)
            more = where(weight > _ZERO, alpha / (_ONE - alpha), _ZERO)
            rest_red, rest_green, rest_blue = load(state, at + _RED), load(state, at + _GREEN), load(state, at + _BLUE)
            store(state, at + _RED, rest_red - weight * red)
            store(state, at + _GREEN, rest_green - weight * green)
            store(state, at + _BLUE, rest_blue - weight * blue)
            apart_red, apart_green = rest_red - before * red, rest_green - before * green
            apart_blue = rest_blue - before * blue
            squared = apart_red * apart_red + apart_green * apart_green + apart_blue * apart_blue
            cost += more * more * (squared + left_over * left_over * _OPACITY)
            lack_red += weight * load(state, at + _LACK_RED)
            lack_green += weight * load(state, at + _LACK_GREEN)
            lack_blue += weight * load(state, at + _LACK_BLUE)
            bound += weight * (_ONE - left_over)
    out[COST], out[BOUND] = total(cost), total(bound)
    out[LACK], out[LACK + 1], out[LACK + 2] = total(lack_red), total(lack_green), total(lack_blue)


@compiled
def add_up(seen: Visible, tiles: Tiles, ends: NDArray, pairs: NDArray, sums: NDArray) -> None:
    """Add the sums of a block's pairs by Gaussian.

    Args:
        seen, tiles: as `kernels_list.list_by_tile` was given them.
        ends: (tiles,) int64, where each list began; moved on.
        pairs: (pairs, 5) float32.
        sums: (rows, 5) float32, of all blocks, added to.
    """
    for entry in range(seen.ids.size):
        reached = seen.boxes[entry]
        for tile_row in range(*rows_of(reached, tiles)):
            for tile in range(*tiles_of(reached, tiles, tile_row)):
                pair = ends[tile - tiles.first]
                for number in range(SUMS):
                    sums[seen.ids[entry], number] += pairs[pair, number]
                ends[tile - tiles.first] += 1


@compiled
def solve_colours(
    basis: NDArray, weights: NDArray, lacks: NDArray, penalties: NDArray, hold: Number, relaxation: Number, sh: NDArray
) -> None:
    """Move SH coefficients towards those that views ask for: a ridge regression by Gaussian and colour.

    With what a Gaussian's colour lacks in view v, l_v, and its weight there, b_v: the minimum over δ of
    Σ_v b_v (Y_v·δ)² − 2 l_v (Y_v·δ) + h |δ|²/4π Σ_v b_v + Σ_k p_k (s_k + δ_k)², by Cholesky's decomposition. The third
    term is that of views from everywhere in which nothing is to change: few views do not bear out all coefficients.

    Args:
        basis: (n, V, B) float64.
        weights: (n, V) float64.
        lacks: (n, V, 3) float64.
        penalties: (B,) float64.
        hold: h.
        relaxation: what δ is multiplied by.
        sh: (n, B, 3) float32, changed.
    """
    views, size = basis.shape[1], basis.shape[2]
    matrix, right = np.empty((size, size)), np.empty((3, size))
    for row in range(len(basis)):
        matrix[:] = 0
        for channel in range(3):
            for i in range(size):
                right[channel, i] = -penalties[i] * sh[row, i, channel]
        for view in range(views):
            weight = weights[row, view]
            if weight == 0:  # it does not show there
                continue
            seen = basis[row, view]
            for i in range(size):
                part = weight * seen[i]
                for j in range(i + 1):
                    matrix[i, j] += part * seen[j]
            for channel in range(3):
                lack = lacks[row, view, channel]
                for i in range(size):
                    right[channel, i] += lack * seen[i]
        if not right.any():
            continue
        held = hold / (4 * math.pi) * weights[row].sum()
        for i in range(size):
            matrix[i, i] += penalties[i] + held + 1e-9
        for k in range(size):
            matrix[k, k] = math.sqrt(max(matrix[k, k], 1e-12))
            for i in range(k + 1, size):
                matrix[i, k] /= matrix[k, k]
                for j in range(k + 1, i + 1):
                    matrix[i, j] -= matrix[i, k] * matrix[j, k]
        for channel in range(3):
            own = right[channel]
            for i in range(size):
                own[i] /= matrix[i, i]
                for k in range(i + 1, size):
                    own[k] -= matrix[k, i] * own[i]
            for i in range(size - 1, -1, -1):
                own[i] /= matrix[i, i]
                for k in range(i):
                    own[k] -= matrix[i, k] * own[i]
                sh[row, i, channel] += _F(relaxation * own[i])
