"""Gradients of Gaussians that belong to no pixels, as compiled code: what `render/kernels_chain.py` is for pixels'."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from ..render.kernels_blend import Tiles, Visible, rows_of, tiles_of
from ..render.kernels_chain import Moved
from ..render.kernels_gradient import BY_RED, PAIR, PULL, PULL_U, PULL_UU, PULL_UW, PULL_W, PULL_WW, exp, place_looks
from ..render.kernels_project import ALPHA_X, AXES, BETA_X, CHUNK, GAMMA, GEOMETRY, MEAN, RED, ViewNumbers
from ..system.kernels_compile import Number, compiled

VALUES = 10
"""Of a Gaussian: how far its mean has moved in each direction, in units of its own, logarithms of its scales, logit of
its opacity, and the red, green and blue coefficient of SH degree 0."""

MOVE, LOG_SCALE, LOGIT, SH_RED = 0, 3, 6, 7
"""Where in `VALUES` they begin."""

BASE = 13
"""Planes of a chunk of what does not change: mean (3) and rotation (9, row by row) as they began, and the unit."""

_F, _I, _ZERO = np.float32, np.uint64, np.float32(0)
_MEAN, _AXES = _I(MEAN * CHUNK), _I(AXES * CHUNK)
_TURNED, _UNIT = _I(3 * CHUNK), _I(12 * CHUNK)


@compiled
def place(base: NDArray, values: NDArray, first: int, geometry: NDArray, sh: NDArray) -> None:
    """Put a block's Gaussians where their values say, a plane of a chunk at a time, which vectorises.

    Args:
        base: (chunks, 13, 128) float32.
        values: (10, rows) float32.
        first: the block's first row of them.
        geometry: (chunks, 14, 128) float32, written; see `kernels_project.project`.
        sh: (chunks, 3 S·128) float32, whose coefficients of degree 0 are written.
    """
    start, out, scales = base.ravel(), geometry.ravel(), np.empty(CHUNK, np.float32)
    for chunk in range(len(base)):
        row, at, to = _I(first + chunk * CHUNK), _I(chunk * BASE * CHUNK), _I(chunk * GEOMETRY * CHUNK)
        for axis in range(3):
            moves, log_scales, plane = values[MOVE + axis], values[LOG_SCALE + axis], _I(axis * CHUNK)
            for lane in range(CHUNK):
                i = _I(lane)
                out[to + _MEAN + plane + i] = start[at + plane + i] + start[at + _UNIT + i] * moves[row + i]
            for lane in range(CHUNK):
                scales[_I(lane)] = _F(exp(np.float64(log_scales[row + _I(lane)])))
            for entry in range(3):
                turned = _I((3 * entry + axis) * CHUNK)
                for lane in range(CHUNK):
                    i = _I(lane)
                    out[to + _AXES + turned + i] = scales[i] * start[at + _TURNED + turned + i]
    place_looks(values[LOGIT:], first, geometry, sh)


@compiled
def add_up(
    records: NDArray,
    seen: Visible,
    tiles: Tiles,
    ends: NDArray,
    pairs: NDArray,
    block: Moved,
    units: NDArray,
    view: ViewNumbers,
) -> None:
    """Add a block's gradients with respect to its values, of one picture.

    Args:
        records, seen, tiles: as `kernels_blend.list_by_tile` was given them.
        ends: (tiles,) int64, where each list began; moved on.
        pairs: (pairs, 9) float32.
        block: the Gaussians, of ten values each; `centre` says nothing here.
        units: (chunks, 128) float32, what their means move in.
        view: as `kernels_project.project` takes it.
    """
    total, slopes, gradient = np.empty(PAIR, np.float64), np.empty(LOGIT, np.float64), block.gradient
    for entry in range(seen.ids.size):
        reached = seen.boxes[entry]
        total[:] = 0
        for tile_row in range(*rows_of(reached, tiles)):
            for tile in range(*tiles_of(reached, tiles, tile_row)):
                pair = ends[tile - tiles.first]
                for number in range(PAIR):
                    total[number] += pairs[pair, number]
                ends[tile - tiles.first] += 1
        record = records[seen.ids[entry]]
        row = seen.ids[entry] - block.first
        chunk, lane = row // CHUNK, row % CHUNK
        _shape_gradient(record, block.geometry[chunk], lane, view, total, slopes)
        for axis in range(3):
            gradient[MOVE + axis, row] += _F(slopes[axis] * units[chunk, lane])
            gradient[LOG_SCALE + axis, row] += _F(slopes[3 + axis])
        rest = 1 + math.exp(np.float64(block.values[LOGIT, row]))  # of the opacity, to 1, inverted
        gradient[LOGIT, row] += _F(total[PULL] / rest)
        for channel in range(3):
            if record[RED + channel] > _ZERO:
                gradient[SH_RED + channel, row] += _F(C0 * total[BY_RED + channel])


@compiled
def _shape_gradient(
    record: NDArray, geometry: NDArray, lane: Number, view: ViewNumbers, total: NDArray, out: NDArray
) -> None:
    """Gradients with respect to the mean (3), scene units, and to logarithms of the scales (3), written to `out`.

    With 2 tr(F dΣ₂ Fᵀ Q) as in `render/kernels_chain.py`; the footprint is Σ mₖ², Σ mₖ nₖ, Σ nₖ² over axes k.
    """
    (ox, oy, oz), ahead = view.offset, view.ahead
    (min_u, min_v), (max_u, max_v) = view.least, view.greatest
    x, y, z = geometry[MEAN, lane] + ox, geometry[MEAN + 1, lane] + oy, geometry[MEAN + 2, lane] + oz
    scale = 1 / (ahead[0] * x + ahead[1] * y + ahead[2] * z)
    u = (view.right[0] * x + view.right[1] * y + view.right[2] * z) * scale
    v = (view.down[0] * x + view.down[1] * y + view.down[2] * z) * scale
    ju, jv = min(max(u, min_u), max_u), min(max(v, min_v), max_v)
    f, g, h = np.float64(record[ALPHA_X]), np.float64(record[BETA_X]), np.float64(record[GAMMA])
    by_a = 2 * f * f * total[PULL_UU]
    by_b = 4 * f * g * total[PULL_UU] + 4 * f * h * total[PULL_UW]
    by_c = 2 * g * g * total[PULL_UU] + 4 * g * h * total[PULL_UW] + 2 * h * h * total[PULL_WW]
    by_u, by_v = 2 * f * total[PULL_U], 2 * (g * total[PULL_U] + h * total[PULL_W])
    deeper = across = down = 0.0  # by relative depth, and by the pixel at which the Jacobian is taken
    for axis in range(3):
        p = q = r = 0.0
        for entry in range(3):
            length = np.float64(geometry[AXES + 3 * entry + axis, lane])
            p += view.right[entry] * length
            q += view.down[entry] * length
            r += ahead[entry] * length
        m, n, r = (p - ju * r) * scale, (q - jv * r) * scale, r * scale
        by_m, by_n = 2 * m * by_a + n * by_b, m * by_b + 2 * n * by_c
        out[3 + axis] = m * by_m + n * by_n
        deeper -= out[3 + axis]
        across -= r * by_m
        down -= r * by_n
    by_u += across if ju == u else 0.0
    by_v += down if jv == v else 0.0
    for axis in range(3):
        du, dv = view.right[axis] - u * ahead[axis], view.down[axis] - v * ahead[axis]
        out[axis] = (by_u * du + by_v * dv + deeper * ahead[axis]) * scale
