"""Gradients of a photo's error as compiled code: what `kernels_blend.py` draws, walked a second time.

A tile's splats are blended as for a picture, and the tile is held against the photo while it is in the cache. The
second walk goes front to back again: with weight w = α·T, an error's gradient with respect to α is T·⟨colour, ∂⟩ less
what lies behind divided by 1 − α, and what lies behind is what the first walk gathered less what the second has passed.

Each pair of tile and splat has a place of its own for its nine sums, in the order in which pairs are listed;
`list/training/kernels_free.py` makes of them what changes by Gaussian.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..system.kernels_compile import Number, compiled, within
from ..system.kernels_lanes import LANES, lanes, load, most, ramp, store, total, where
from .composite import ALPHA_MAX
from .kernels_blend import (
    AHEAD,
    PLANES,
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
from .kernels_list import TILE_HEIGHT, TILE_WIDTH, Listed
from .kernels_project import ALPHA_X, BETA_X, BLUE, GAMMA, GREEN, LOG_OPACITY, REACH, RED, X, Y

PAIR = 9
"""Sums of a pair of tile and splat."""

PULL, PULL_U, PULL_W, PULL_UU, PULL_UW, PULL_WW, BY_RED, BY_GREEN, BY_BLUE = range(PAIR)
"""Which they are: pull, pull·u, pull·w, pull·u², pull·u·w, pull·w², and weight by colour's gradient (3), where u and w
are whitened pixels and pull is the gradient with respect to the exponent."""

SUMS = 2
"""Of a tile: squared error of values clipped to [0, 1], and number of pixels that the photo knows. Pixels whose red is
NaN count nowhere and have no gradient."""

BLOCK = 8
"""Pixels a side of the blocks that SSIM is taken over, which tiles consist of: within one its gradient by a pixel is a
sum of three terms that the block's means and variances give."""

_BLOCKS = TILE_WIDTH // BLOCK
_C1, _C2 = 0.01**2, 0.03**2  # of Wang et al. 2004

_F, _I = np.float32, np.uint64
_STRIDE = TILE_WIDTH + LANES
_RED, _GREEN, _BLUE, _BEHIND = (_I(plane * _STRIDE) for plane in range(1, PLANES))
_ALPHA_MAX = _F(ALPHA_MAX)
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)


class Sought(NamedTuple):
    """What a picture is held against, and how.

    Attributes:
        photo: (H, W, 3) float32, NaN where nothing is known.
        weight: what a unit of the loss counts in gradients.
        structure: share of 1 − SSIM in it, beside |error|.
        backdrop: how bright the picture is behind all splats.
    """

    photo: NDArray
    weight: np.float32
    structure: np.float32
    backdrop: np.float32


@compiled
def measure_tile(listed: Listed, extent: Extent, work: Scratch, sought: Sought, sums: NDArray, pairs: NDArray) -> None:
    """Draw a tile, hold it against the photo, and walk its splats again for their sums.

    Args:
        listed, extent, work: as `kernels_blend.blend_tile` has them.
        sought: the photo.
        sums: (2,) float64, written.
        pairs: (pairs, 9) float32, written at the tile's places; (0, 9) where none are wanted.
    """
    if pairs.size:
        for key in listed.keys:
            pairs[key & _I(0xFFFFFFFF)] = 0
    if not _is_known(sought.photo, extent):
        sums[:] = 0
        return
    keys, count = blend_tile(listed, extent, work, np.bool_(False))
    _compare(work.state, sought, extent, sums)
    if pairs.size:
        _walk_again(listed, keys[:count], extent, work, pairs)


@compiled
def differentiate_tile(listed: Listed, extent: Extent, work: Scratch, slopes: NDArray, pairs: NDArray) -> None:
    """Draw a tile, and walk its splats again for sums of any loss.

    Args:
        listed, extent, work: as `kernels_blend.blend_tile` has them.
        slopes: (H, W, 4) float32, the loss's gradient with respect to the picture and its transmittance.
        pairs: as `measure_tile` has them.
    """
    for key in listed.keys:
        pairs[key & _I(0xFFFFFFFF)] = 0
    keys, count = blend_tile(listed, extent, work, np.bool_(False))
    state = work.state
    for line in range(extent.rows):
        for lane in range(extent.columns):
            at, row, column = line * ROW + lane, extent.row + line, extent.column + lane
            behind = abs(state[at]) * slopes[row, column, 3]
            for channel in range(3):
                plane, slope = at + (1 + channel) * _STRIDE, slopes[row, column, channel]
                behind += slope * state[plane]
                state[plane] = slope
            state[at], state[at + 4 * _STRIDE] = _ONE, behind
    _walk_again(listed, keys[:count], extent, work, pairs)


@within
def _walk_again(listed: Listed, keys: NDArray, extent: Extent, work: Scratch, pairs: NDArray) -> None:
    """Walk what was blended of a tile's list for its sums, where a pixel's state is full transmittance, the gradient by
    its colour, and what lies behind the first splat.
    """
    state, near = work.state, work.near
    for start in range(0, keys.size, AHEAD):
        end = min(start + AHEAD, keys.size)
        bring_near(listed, keys[start:end], near)
        for entry in range(end - start):
            _walk(near[entry], extent, state, pairs[keys[start + entry] & _I(0xFFFFFFFF)])


@within
def _is_known(photo: NDArray, extent: Extent) -> bool:
    """Whether a photo knows any pixel of a tile."""
    for line in range(extent.rows):
        for lane in range(extent.columns):
            if not np.isnan(photo[extent.row + line, extent.column + lane, 0]):
                return True
    return False


@within
def _compare(state: NDArray, sought: Sought, extent: Extent, sums: NDArray) -> None:
    """Sum a tile's errors, and turn its state into that of the second walk: full transmittance, the error's gradient by
    colour, and what lies behind the first splat.
    """
    row, column, photo, structure = extent.row, extent.column, sought.photo, sought.structure
    terms = np.empty((3, TILE_HEIGHT // BLOCK, _BLOCKS, 3), np.float32)
    _compare_blocks(state, sought, extent, terms)
    squared, known = 0.0, 0
    for line in range(extent.rows):
        for lane in range(extent.columns):
            at = line * ROW + lane
            is_known, behind = not np.isnan(photo[row + line, column + lane, 0]), _ZERO
            lit = abs(state[at]) * sought.backdrop
            for channel in range(3):
                plane = at + (1 + channel) * _STRIDE
                found, wanted = state[plane] + lit, photo[row + line, column + lane, channel]
                if not is_known:
                    state[plane] = _ZERO
                    continue
                error = np.float64(found - wanted)
                clipped = np.float64(min(max(found, _ZERO), _ONE) - wanted)
                sign = 1.0 if error > 0 else (-1.0 if error < 0 else 0.0)
                squared += clipped * clipped
                by_block = terms[channel, line // BLOCK, lane // BLOCK]
                alike = by_block[0] + by_block[1] * found + by_block[2] * wanted
                slope = ((_ONE - structure) * _F(sign) - structure * alike) * sought.weight
                state[plane] = slope
                behind += slope * found
            known += is_known
            state[at], state[at + 4 * _STRIDE] = _ONE, behind
    sums[0], sums[1] = squared, known


@within
def _compare_blocks(state: NDArray, sought: Sought, extent: Extent, terms: NDArray) -> None:
    """What the gradient of SSIM of a tile's blocks consists of.

    Args:
        state, sought, extent: as `_compare` has them, the state as blended.
        terms: (3, 4, 16, 3) float32, written by colour and block: where a pixel is seen as x and the photo has y, the
            gradient of SSIM times the block's pixels is terms[0] + terms[1] · x + terms[2] · y; 0 where some of it is
            not known.
    """
    photo, backdrop = sought.photo, np.float64(sought.backdrop)
    terms[:] = _ZERO
    for top in range(0, extent.rows, BLOCK):
        for left in range(0, extent.columns, BLOCK):
            bottom, right = min(top + BLOCK, extent.rows), min(left + BLOCK, extent.columns)
            is_known = True
            for line in range(top, bottom):
                for lane in range(left, right):
                    is_known &= not np.isnan(photo[extent.row + line, extent.column + lane, 0])
            if not is_known:
                continue
            pixels = (bottom - top) * (right - left)
            for channel in range(3):
                x = y = xx = yy = xy = 0.0
                for line in range(top, bottom):
                    start = line * ROW + (1 + channel) * _STRIDE
                    for lane in range(left, right):
                        seen = np.float64(state[start + lane]) + abs(state[line * ROW + lane]) * backdrop
                        wanted = np.float64(photo[extent.row + line, extent.column + lane, channel])
                        x, y = x + seen, y + wanted
                        xx, yy, xy = xx + seen * seen, yy + wanted * wanted, xy + seen * wanted
                x, y = x / pixels, y / pixels
                xx, yy, xy = max(xx / pixels - x * x, 0.0), max(yy / pixels - y * y, 0.0), xy / pixels - x * y
                means, spreads = x * x + y * y + _C1, xx + yy + _C2
                level, likeness = (2 * x * y + _C1) / means, (2 * xy + _C2) / spreads
                alike = level * likeness
                by_seen, by_wanted = -2 * alike / spreads, 2 * level / spreads
                block = terms[channel, top // BLOCK, left // BLOCK]
                block[0] = _F(2 * (y * likeness - x * alike) / means - by_seen * x - by_wanted * y)
                block[1], block[2] = _F(by_seen), _F(by_wanted)


@within
def _walk(splat: NDArray, extent: Extent, state: NDArray, out: NDArray) -> None:
    """Write the sums of a splat over a tile; visits the pixels that `kernels_blend.blend_splat` visits."""
    x, y, alpha_x, beta_x, gamma = splat[X] - _F(extent.column), splat[Y], splat[ALPHA_X], splat[BETA_X], splat[GAMMA]
    log_opacity = splat[LOG_OPACITY]
    colour = splat[RED], splat[GREEN], splat[BLUE]
    (left, right, top, bottom), is_wide = box(splat, extent), splat[REACH] > _ZERO
    pull = pull_u = pull_w = pull_uu = pull_uw = pull_ww = g_red = g_green = g_blue = lanes(_ZERO)
    step = ramp() * alpha_x
    for row in range(top, bottom + 1):
        dy = _F(row) + _HALF - y
        w = gamma * dy
        exponent = log_opacity - w * w
        first, last = columns_in(splat, extent, dy) if is_wide else (left, right)
        start = _I((row - extent.row) * ROW)
        for column in range(first, last + 1, LANES):
            at, u = start + _I(column), step + (alpha_x * (_F(column) + _HALF - x) + beta_x * dy)
            full = alphas(u, exponent)
            pulled, red, green, blue = _pass_by(state, at, cut(full), colour)
            pulled = where(full <= _ALPHA_MAX, pulled, _ZERO)
            along, across = pulled * u, pulled * w
            pull += pulled
            pull_u += along
            pull_w += across
            pull_uu += along * u
            pull_uw += along * w
            pull_ww += across * w
            g_red += red
            g_green += green
            g_blue += blue
    out[PULL], out[PULL_U], out[PULL_W] = total(pull), total(pull_u), total(pull_w)
    out[PULL_UU], out[PULL_UW], out[PULL_WW] = total(pull_uu), total(pull_uw), total(pull_ww)
    out[BY_RED], out[BY_GREEN], out[BY_BLUE] = total(g_red), total(g_green), total(g_blue)


Colour = tuple[Number, Number, Number]


@within
def _pass_by(state: NDArray, at: Number, alpha: Number, colour: Colour) -> tuple[Number, Number, Number, Number]:
    """Take eight alphas from what their pixels let through: the gradient by their exponents, and weight by colour's
    gradient.
    """
    red, green, blue = colour
    before = load(state, at)
    weight, after = blend(before, alpha)
    store(state, at, after)
    d_red, d_green, d_blue = load(state, at + _RED), load(state, at + _GREEN), load(state, at + _BLUE)
    along = d_red * red + d_green * green + d_blue * blue
    behind = load(state, at + _BEHIND) - weight * along
    store(state, at + _BEHIND, behind)
    pulled = alpha * (most(before, _ZERO) * along - behind / (_ONE - alpha))
    return where(weight > _ZERO, pulled, _ZERO), weight * d_red, weight * d_green, weight * d_blue
