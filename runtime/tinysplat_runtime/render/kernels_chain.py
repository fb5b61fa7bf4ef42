"""From sums of pairs of tile and splat to gradients by Gaussian: the second half of `kernels_gradient.py`.

Adding sums up by Gaussian replays the listing of pairs, so results depend on neither the number of threads nor their
haste. The chain from sums to values needs no derivative of a covariance: in whitened pixels y = F·d with exponent −|y|²
(F has αx, βx and γ), Σ₂ enters as 2 tr(F dΣ₂ Fᵀ Σ pull·y·yᵀ), which needles do not cancel. What turns with the
direction that colours of SH degree 1 and up are seen from is left out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from .kernels_gradient import LOG_DEPTH, LOG_SIZE, LOGIT, PAIR, SH_RED
from .kernels_project import ALPHA_X, BETA_X, CHUNK, GAMMA, RED, Number, compiled
from .project import DILATION, LEAST_OWN_PIXEL, LEAST_VARIANCE

_F, _ZERO = np.float32, np.float32(0)


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
        view: (23,) float64, as `kernels_project.project` takes it.
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
