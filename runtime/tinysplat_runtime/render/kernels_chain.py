"""From sums of pairs of tile and splat to gradients by Gaussian: the second half of `kernels_gradient.py`.

Adding sums up by Gaussian replays the listing of pairs, so results depend on neither the number of threads nor their
haste. The chain from sums to values needs no derivative of a covariance: in whitened pixels y = F·d with exponent −|y|²
(F has αx, βx and γ), Σ₂ enters as 2 tr(F dΣ₂ Fᵀ Σ pull·y·yᵀ), which needles do not cancel. What turns with the
direction that colours of SH degree 1 and up are seen from is left out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from .kernels_blend import Tiles, Visible, rows_of, tiles_of
from .kernels_gradient import (
    BY_RED,
    LOG_DEPTH,
    LOG_SIZE,
    LOGIT,
    PAIR,
    PULL,
    PULL_U,
    PULL_UU,
    PULL_UW,
    PULL_W,
    PULL_WW,
    SH_RED,
)
from .kernels_project import ALPHA_X, AXES, BETA_X, CHUNK, GAMMA, MEAN, OWN_PIXEL, RED, Number, ViewNumbers, compiled
from .project import DILATION, LEAST_OWN_PIXEL, LEAST_VARIANCE

_F, _ZERO = np.float32, np.float32(0)


class Moved(NamedTuple):
    """A block of Gaussians that move.

    Attributes:
        first: its first row.
        geometry: (chunks, 14, 128) float32, as they stand.
        centre: (3,) float64, of the own camera, relative to the Gaussians' origin.
        values: (6, rows) float32.
    """

    first: int
    geometry: NDArray
    centre: NDArray
    values: NDArray


@compiled
def add_up(
    records: NDArray,
    seen: Visible,
    tiles: Tiles,
    ends: NDArray,
    pairs: NDArray,
    block: Moved,
    view: ViewNumbers,
    gradient: NDArray,
) -> None:
    """Add a block's gradients with respect to its values, of one photo.

    Args:
        records, seen, tiles: as `kernels_blend.list_by_tile` was given them.
        ends: (tiles,) int64, where each list began; moved on.
        pairs: (pairs, 9) float32.
        block: the Gaussians.
        view: as `kernels_project.project` takes it.
        gradient: (6, rows) float32 of the block, added to.
    """
    total = np.empty(PAIR, np.float64)
    for entry in range(seen.ids.size):
        reached = seen.boxes[entry]
        total[:] = 0
        for tile_row in range(*rows_of(reached, tiles)):
            for tile in range(*tiles_of(reached, tiles, tile_row)):
                pair = ends[tile - tiles.first]
                for number in range(PAIR):
                    total[number] += pairs[pair, number]
                ends[tile - tiles.first] += 1
        if not total.any():
            continue  # hidden, or where the photo knows nothing
        record = records[seen.ids[entry]]
        row = seen.ids[entry] - block.first
        chunk, lane = block.geometry[row // CHUNK], row % CHUNK
        along_depth, along_size = _shape_gradient(record, chunk, lane, block.centre, view, total)
        gradient[LOG_DEPTH, row] += _F(along_depth)
        gradient[LOG_SIZE, row] += _F(along_size)
        rest = 1 + math.exp(np.float64(block.values[LOGIT, row]))  # of the opacity, to 1, inverted
        gradient[LOGIT, row] += _F(total[PULL] / rest)
        for channel in range(3):
            if record[RED + channel] > _ZERO:
                gradient[SH_RED + channel, row] += _F(C0 * total[BY_RED + channel])


@compiled
def _shape_gradient(
    record: NDArray, geometry: NDArray, lane: Number, centre: NDArray, view: ViewNumbers, total: NDArray
) -> tuple[Number, Number]:
    """Gradients with respect to log depth, along the own camera's ray, and log size."""
    (ox, oy, oz), (centre_x, centre_y, centre_z) = view.offset, (centre[0], centre[1], centre[2])
    (p00, p01, p02), (p10, p11, p12), (p20, p21, p22) = view.right, view.down, view.ahead
    (min_u, min_v), (max_u, max_v) = view.least, view.greatest
    x, y = np.float64(geometry[MEAN, lane]), np.float64(geometry[MEAN + 1, lane])
    z = np.float64(geometry[MEAN + 2, lane])
    ray_x, ray_y, ray_z = x - centre_x, y - centre_y, z - centre_z
    x, y, z = x + ox, y + oy, z + oz
    scale = 1 / (p20 * x + p21 * y + p22 * z)
    # Pixel of the mean and its change, both from the principal point
    u, v = (p00 * x + p01 * y + p02 * z) * scale, (p10 * x + p11 * y + p12 * z) * scale
    deeper = (p20 * ray_x + p21 * ray_y + p22 * ray_z) * scale  # relative change of depth
    du = (p00 * ray_x + p01 * ray_y + p02 * ray_z) * scale - u * deeper
    dv = (p10 * ray_x + p11 * ray_y + p12 * ray_z) * scale - v * deeper
    ju, jv = min(max(u, min_u), max_u), min(max(v, min_v), max_v)
    dju, djv = du if ju == u else 0.0, dv if jv == v else 0.0
    # Rows m and n of J·W·axes; with the ray, axes grow too, which undoes the Jacobian's fall by depth in part
    aa = ab = bb = a_da = ab_d = b_db = 0.0
    for axis in range(3):
        p = q = r = 0.0
        for entry in range(3):
            length = np.float64(geometry[AXES + 3 * entry + axis, lane])
            p += view.right[entry] * length
            q += view.down[entry] * length
            r += view.ahead[entry] * length
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
    by_a = 2 * f * f * total[PULL_UU]
    by_b = 4 * f * g * total[PULL_UU] + 4 * f * h * total[PULL_UW]
    by_c = 2 * g * g * total[PULL_UU] + 4 * g * h * total[PULL_UW] + 2 * h * h * total[PULL_WW]
    by_u, by_v = 2 * f * total[PULL_U], 2 * (g * total[PULL_U] + h * total[PULL_W])
    along_depth = by_u * du + by_v * dv + 2 * a_da * by_a + ab_d * by_b + 2 * b_db * by_c
    along_size = 2 * (aa * by_a + ab * by_b + bb * by_c)
    own = np.float64(geometry[OWN_PIXEL, lane]) * view.focal * scale
    covariance, change = (aa, ab, bb), (2 * a_da, ab_d, 2 * b_db)
    if own > 1:
        wider, wider_size = _widening(own, 1 - deeper, covariance, change)
        along_depth += wider * (by_a + by_c)
        along_size += wider_size * (by_a + by_c)
    elif own > 0:
        faded, faded_size = _fading(own, 1 - deeper, covariance, change)
        along_depth += faded * total[PULL]
        along_size += faded_size * total[PULL]
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
