"""Gaussians where their values put them, and from sums of pairs of tile and splat to gradients by Gaussian, as compiled
code: the second half of `render/kernels_gradient.py`.

Adding sums up by Gaussian replays the listing of pairs, so results depend on neither the number of threads nor their
haste. The chain from sums to values needs no derivative of a covariance: in whitened pixels y = F·d with exponent −|y|²
(F has αx, βx and γ), Σ₂ enters as 2 tr(F dΣ₂ Fᵀ Σ pull·y·yᵀ), which needles do not cancel. What turns with the
direction that colours of SH degree 1 and up are seen from is left out.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...gaussian.sh import C0, band_1, band_2
from ...render.kernels_gradient import BY_RED, PAIR, PULL, PULL_U, PULL_UU, PULL_UW, PULL_W, PULL_WW
from ...render.kernels_list import Tiles, Visible, rows_of, tiles_of
from ...render.kernels_project import ALPHA_X, AXES, BETA_X, CHUNK, GAMMA, GEOMETRY, MEAN, OPACITY, RED, ViewNumbers
from ...system.kernels_compile import Number, compiled, within

MOVE, LOG_SCALE, TURN, LOGIT, SH_RED = 0, 3, 6, 10, 11
"""Where values of a Gaussian begin: how far its mean has moved in each direction, in units of its own, logarithms of
its scales, a quaternion of any length, the logit of its opacity, and the red, green and blue coefficients of those SH
functions that move, function by function."""

MOST_FUNCTIONS = 9
"""SH functions that can move: up to degree 2."""

BASE = 4
"""Planes of a chunk of what does not change: mean (3) as it began, and the unit."""

_F, _I, _ZERO = np.float32, np.uint64, np.float32(0)
_MEAN, _AXES, _OPACITY = (_I(plane * CHUNK) for plane in (MEAN, AXES, OPACITY))
_UNIT = _I(3 * CHUNK)
_SLOPES = 9
_BAND_1, _BAND_2 = within(band_1), within(band_2)


class Moved(NamedTuple):
    """A block of Gaussians that move, and where their gradients go.

    Attributes:
        first: its first row.
        geometry: (chunks, 14, 128) float32, as they stand.
        units: (chunks, 128) float32, what their means move in.
        values: (kinds, rows) float32, of all blocks: columns of an array would be compiled a second time.
        gradient: (kinds, rows) float32 with respect to them, added to.
    """

    first: int
    geometry: NDArray
    units: NDArray
    values: NDArray
    gradient: NDArray


def values_of(functions: int) -> int:
    """How many values a Gaussian has of which so many SH functions move."""
    return SH_RED + 3 * functions


@compiled
def place(base: NDArray, values: NDArray, first: int, geometry: NDArray, sh: NDArray) -> None:
    """Put a block's Gaussians where their values say, a plane of a chunk at a time, which vectorises.

    Args:
        base: (chunks, 4, 128) float32.
        values: (kinds, rows) float32.
        first: the block's first row of them.
        geometry: (chunks, 14, 128) float32, written; see `kernels_project.project`.
        sh: (chunks, 3 S·128) float32, whose coefficients that move are written.
    """
    start, out = base.ravel(), geometry.ravel()
    scales, turns = np.empty((3, CHUNK), np.float32), np.empty((9, CHUNK), np.float32)
    for chunk in range(len(base)):
        row, at, to = _I(first + chunk * CHUNK), _I(chunk * BASE * CHUNK), _I(chunk * GEOMETRY * CHUNK)
        _turn(values[TURN:LOGIT], row, turns)
        for axis in range(3):
            moves, log_scales, plane = values[MOVE + axis], values[LOG_SCALE + axis], _I(axis * CHUNK)
            for lane in range(CHUNK):
                i = _I(lane)
                out[to + _MEAN + plane + i] = start[at + plane + i] + start[at + _UNIT + i] * moves[row + i]
            for lane in range(CHUNK):
                scales[axis, lane] = _F(_exp(np.float64(log_scales[row + _I(lane)])))
            for entry in range(3):
                place = _I((3 * entry + axis) * CHUNK)
                for lane in range(CHUNK):
                    out[to + _AXES + place + _I(lane)] = scales[axis, lane] * turns[3 * entry + axis, lane]
    _place_looks(values[LOGIT:], first, geometry, sh)


@within
def _place_looks(looks: NDArray, first: int, geometry: NDArray, sh: NDArray) -> None:
    """Give a block's Gaussians the opacities and colours that their values say.

    Args:
        looks: (1 + n, rows) float32: logits, and the first n planes of `sh`, three or more.
        first, geometry, sh: as `place` has them.
    """
    logits, out, colours = looks[0], geometry.ravel(), sh.ravel()
    for chunk in range(len(sh)):
        row, to = _I(first + chunk * CHUNK), _I(chunk * GEOMETRY * CHUNK)
        for lane in range(CHUNK):
            out[to + _OPACITY + _I(lane)] = _F(_log_sigmoid(np.float64(logits[row + _I(lane)])))
        for number in range(len(looks) - 1):
            colour, plane = looks[1 + number], _I(chunk * sh.shape[1] + number * CHUNK)
            for lane in range(CHUNK):
                colours[plane + _I(lane)] = colour[row + _I(lane)]


@within
def _exp(x: Number) -> Number:
    """e^x, float64 to a billionth, x cut to [−80, 80], as arithmetic that vectorises: no call of a library does."""
    x = x if x > -80 else -80.0
    x = x if x < 80 else 80.0
    biased = np.int32(x * 1.4426950408889634 + 127.5)  # the nearest power of two, and 127
    r = x - (np.float64(biased) - 127) * 0.6931471805599453
    p = r / 40320 + 1 / 5040
    p = p * r + 1 / 720
    p = p * r + 1 / 120
    p = p * r + 1 / 24
    p = p * r + 1 / 6
    p = p * r + 0.5
    return (p * r * r + r + 1) * np.float64(np.int32(biased << np.int32(23)).view(np.float32))


@within
def _log_sigmoid(x: Number) -> Number:
    """log(1 / (1 + e^−x)), float64 to a billionth: 1 + e^−|x| by the series of 2 artanh(s), s at most 1/3."""
    t = _exp(-abs(x))
    s = t / (2 + t)
    q = s * s
    p = q / 17 + 1 / 15
    p = p * q + 1 / 13
    p = p * q + 1 / 11
    p = p * q + 1 / 9
    p = p * q + 1 / 7
    p = p * q + 1 / 5
    p = p * q + 1 / 3
    return (x if x < 0 else 0.0) - 2 * (p * q * s + s)


@within
def _turn(quats: NDArray, row: Number, out: NDArray) -> None:
    """Rotation matrices of a chunk, written to (9, 128) float32 row by row; `quats` (4, rows) float32."""
    for lane in range(CHUNK):
        i = row + _I(lane)
        w, x, y, z = quats[0, i], quats[1, i], quats[2, i], quats[3, i]
        twice = _F(2) / max(w * w + x * x + y * y + z * z, _F(1e-30))
        out[0, lane], out[4, lane] = _F(1) - twice * (y * y + z * z), _F(1) - twice * (x * x + z * z)
        out[8, lane] = _F(1) - twice * (x * x + y * y)
        out[1, lane], out[3, lane] = twice * (x * y - w * z), twice * (x * y + w * z)
        out[2, lane], out[6, lane] = twice * (x * z + w * y), twice * (x * z - w * y)
        out[5, lane], out[7, lane] = twice * (y * z - w * x), twice * (y * z + w * x)


@compiled
def add_up(
    records: NDArray, seen: Visible, tiles: Tiles, ends: NDArray, pairs: NDArray, block: Moved, view: ViewNumbers
) -> None:
    """Add a block's gradients with respect to its values, of one picture.

    Args:
        records, seen, tiles: as `kernels_list.list_by_tile` was given them.
        ends: (tiles,) int64, where each list began; moved on.
        pairs: (pairs, 9) float32.
        block: the Gaussians, of `values_of` values each.
        view: as `kernels_project.project` takes it.
    """
    total, slopes, gradient = np.empty(PAIR, np.float64), np.empty(_SLOPES, np.float64), block.gradient
    functions, basis = (len(gradient) - SH_RED) // 3, np.empty(MOST_FUNCTIONS, np.float64)
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
        row = seen.ids[entry]
        chunk, lane = (row - block.first) // CHUNK, (row - block.first) % CHUNK
        _shape_gradient(record, block.geometry[chunk], lane, view, total, slopes)
        for axis in range(3):
            gradient[MOVE + axis, row] += _F(slopes[axis] * block.units[chunk, lane])
            gradient[LOG_SCALE + axis, row] += _F(slopes[3 + axis])
        _add_turn(block.values[TURN:LOGIT, row], slopes[6:], gradient[TURN:LOGIT, row])
        rest = 1 + math.exp(np.float64(block.values[LOGIT, row]))  # of the opacity, to 1, inverted
        gradient[LOGIT, row] += _F(total[PULL] / rest)
        _functions(block.geometry[chunk], lane, view, functions, basis)
        for channel in range(3):
            if record[RED + channel] > _ZERO:
                for function in range(functions):
                    gradient[SH_RED + 3 * function + channel, row] += _F(basis[function] * total[BY_RED + channel])


@within
def _add_turn(quat: NDArray, torque: NDArray, out: NDArray) -> None:
    """Add the gradient with respect to a quaternion (4,), by that of turning about the world's axes (3,)."""
    w, x, y, z = np.float64(quat[0]), np.float64(quat[1]), np.float64(quat[2]), np.float64(quat[3])
    # A turn by θ about an axis moves the unit quaternion by θ/2 along (0, axis)·q, and there is no other way to move
    twice = 2 / max(w * w + x * x + y * y + z * z, 1e-30)
    a, b, c = torque[0] * twice, torque[1] * twice, torque[2] * twice
    out[0] -= _F(a * x + b * y + c * z)
    out[1] += _F(a * w + b * z - c * y)
    out[2] += _F(b * w + c * x - a * z)
    out[3] += _F(c * w + a * y - b * x)


@within
def _functions(geometry: NDArray, lane: Number, view: ViewNumbers, functions: int, out: NDArray) -> None:
    """The first SH functions, 1, 4 or 9, in the direction that a Gaussian is seen in."""
    out[0] = C0
    if functions == 1:
        return
    (ox, oy, oz) = view.offset
    x, y, z = geometry[MEAN, lane] + ox, geometry[MEAN + 1, lane] + oy, geometry[MEAN + 2, lane] + oz
    shorter = 1 / math.sqrt(x * x + y * y + z * z)
    x, y, z = x * shorter, y * shorter, z * shorter
    out[1], out[2], out[3] = _BAND_1(x, y, z)
    if functions > 4:
        out[4], out[5], out[6], out[7], out[8] = _BAND_2(x, y, z, x * x, y * y, z * z)


@within
def _shape_gradient(
    record: NDArray, geometry: NDArray, lane: Number, view: ViewNumbers, total: NDArray, out: NDArray
) -> None:
    """Gradients with respect to the mean (3), scene units, logarithms of the scales (3), and turning about the world's
    axes (3), written to `out`.

    The footprint is Σ mₖ², Σ mₖ nₖ, Σ nₖ² over axes k.
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
    out[6] = out[7] = out[8] = 0.0
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
        # The axis turns: by how its end moves, a × ∂
        ax, ay, az = geometry[AXES + axis, lane], geometry[AXES + 3 + axis, lane], geometry[AXES + 6 + axis, lane]
        by_m, by_n = by_m * scale, by_n * scale
        by_x = by_m * (view.right[0] - ju * ahead[0]) + by_n * (view.down[0] - jv * ahead[0])
        by_y = by_m * (view.right[1] - ju * ahead[1]) + by_n * (view.down[1] - jv * ahead[1])
        by_z = by_m * (view.right[2] - ju * ahead[2]) + by_n * (view.down[2] - jv * ahead[2])
        out[6] += ay * by_z - az * by_y
        out[7] += az * by_x - ax * by_z
        out[8] += ax * by_y - ay * by_x
    by_u += across if ju == u else 0.0
    by_v += down if jv == v else 0.0
    for axis in range(3):
        du, dv = view.right[axis] - u * ahead[axis], view.down[axis] - v * ahead[axis]
        out[axis] = (by_u * du + by_v * dv + deeper * ahead[axis]) * scale
