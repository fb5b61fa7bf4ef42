"""From sums of pairs of tile and splat to gradients by Gaussian: the second half of `kernels_gradient.py`.

Adding sums up by Gaussian replays the listing of pairs, so results depend on neither the number of threads nor their
haste. The chain from sums to values needs no derivative of a covariance: in whitened pixels y = F·d with exponent −|y|²
(F has αx, βx and γ), Σ₂ enters as 2 tr(F dΣ₂ Fᵀ Σ pull·y·yᵀ), which needles do not cancel. What turns with the
direction that colours of SH degree 1 and up are seen from is left out.

Sums are added up for a chunk of 128 Gaussians, plane by plane in one array as in `kernels_project.py`, and the chain is
then worked out for all of them by vector instructions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0
from ..system.kernels_compile import Number, compiled
from .kernels_gradient import BY_RED, PAIR, PULL, PULL_U, PULL_UU, PULL_UW, PULL_W, PULL_WW
from .kernels_list import Tiles, Visible, rows_of, tiles_of
from .kernels_place import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED, VALUES, exp
from .kernels_project import ALPHA_X, AXES, BETA_X, CHUNK, GAMMA, GEOMETRY, MEAN, OWN_PIXEL, RED, ViewNumbers, clipped
from .project import DILATION, LEAST_OWN_PIXEL, LEAST_VARIANCE

_F, _I, _ZERO = np.float32, np.uint64, np.float32(0)
_WORK = PAIR + 4  # planes of a chunk: sums, αx, βx, γ, logit; of these, gradients take the place of sums
_P = tuple(_I(CHUNK * plane) for plane in range(max(_WORK, GEOMETRY)))
_FACTORS, _LOGIT = PAIR, PAIR + 3


class Moved(NamedTuple):
    """A block of Gaussians that move, and where their gradients go.

    Attributes:
        first: its first row.
        geometry: (chunks, 14, 128) float32, as they stand.
        centre: (3,) float64, of the own camera, relative to the Gaussians' origin.
        values: (6, rows) float32.
        gradient: (6, rows) float32 with respect to them, added to.
    """

    first: int
    geometry: NDArray
    centre: NDArray
    values: NDArray
    gradient: NDArray


@compiled
def add_up(
    records: NDArray, seen: Visible, tiles: Tiles, ends: NDArray, pairs: NDArray, block: Moved, view: ViewNumbers
) -> None:
    """Add a block's gradients with respect to its values, of one photo.

    Args:
        records, seen, tiles: as `kernels_list.list_by_tile` was given them.
        ends: (tiles,) int64, where each list began; moved on.
        pairs: (pairs, 9) float32.
        block: the Gaussians.
        view: as `kernels_project.project` takes it.
    """
    ids, boxes, logits = seen.ids, seen.boxes, block.values[LOGIT]
    work, lanes, entry = np.zeros(_WORK * CHUNK, np.float64), np.empty(CHUNK, np.int64), 0
    geometry = block.geometry.ravel()
    while entry < ids.size:
        chunk, moved = (ids[entry] - block.first) // CHUNK, 0
        start = block.first + chunk * CHUNK
        while entry < ids.size and ids[entry] < start + CHUNK:
            record, lane, found = ids[entry], ids[entry] - start, False
            for number in range(PAIR):
                work[_I(number * CHUNK + lane)] = 0
            # Written out, as a call would count references for every splat
            reached = boxes[entry, 0], boxes[entry, 1], boxes[entry, 2], boxes[entry, 3]
            for tile_row in range(*rows_of(reached, tiles)):
                for tile in range(*tiles_of(reached, tiles, tile_row)):
                    pair = ends[tile - tiles.first]
                    ends[tile - tiles.first] += 1
                    for number in range(PAIR):
                        found |= pairs[_I(pair), _I(number)] != _ZERO
                        work[_I(number * CHUNK + lane)] += pairs[_I(pair), _I(number)]
            entry += 1
            if not found:
                continue  # hidden, or where the photo knows nothing
            for channel in range(3):
                if not records[record, RED + channel] > _ZERO:
                    work[_I((BY_RED + channel) * CHUNK + lane)] = 0
            work[_I(_FACTORS * CHUNK + lane)] = records[record, ALPHA_X]
            work[_I((_FACTORS + 1) * CHUNK + lane)] = records[record, BETA_X]
            work[_I((_FACTORS + 2) * CHUNK + lane)] = records[record, GAMMA]
            work[_I(_LOGIT * CHUNK + lane)] = logits[record - block.first]
            lanes[moved] = lane
            moved += 1
        if moved:
            _chain(geometry, _I(chunk * GEOMETRY * CHUNK), block.centre, view, work)
        for kind in range(VALUES):
            for lane in lanes[:moved]:
                block.gradient[kind, chunk * CHUNK + lane] += _F(work[_I(kind * CHUNK + lane)])


@compiled
def _chain(geometry: NDArray, start: Number, centre: NDArray, view: ViewNumbers, work: NDArray) -> None:
    """Gradients with respect to values, in place of sums; log depth is that along the own camera's ray."""
    (ox, oy, oz), (centre_x, centre_y, centre_z) = view.offset, (centre[0], centre[1], centre[2])
    (p00, p01, p02), (p10, p11, p12), (p20, p21, p22) = view.right, view.down, view.ahead
    (min_u, min_v), (max_u, max_v) = view.least, view.greatest
    for lane in range(CHUNK):
        i = _I(lane)
        at = start + i
        x, y = np.float64(geometry[at + _P[MEAN]]), np.float64(geometry[at + _P[MEAN + 1]])
        z = np.float64(geometry[at + _P[MEAN + 2]])
        ray_x, ray_y, ray_z = x - centre_x, y - centre_y, z - centre_z
        x, y, z = x + ox, y + oy, z + oz
        scale = 1 / (p20 * x + p21 * y + p22 * z)
        # Pixel of the mean and its change, both from the principal point
        u, v = (p00 * x + p01 * y + p02 * z) * scale, (p10 * x + p11 * y + p12 * z) * scale
        deeper = (p20 * ray_x + p21 * ray_y + p22 * ray_z) * scale  # relative change of depth
        du = (p00 * ray_x + p01 * ray_y + p02 * ray_z) * scale - u * deeper
        dv = (p10 * ray_x + p11 * ray_y + p12 * ray_z) * scale - v * deeper
        ju, jv = clipped(u, min_u, max_u), clipped(v, min_v, max_v)
        dju, djv = du if ju == u else 0.0, dv if jv == v else 0.0
        # Rows m and n of J·W·axes; with the ray, axes grow too, which undoes the Jacobian's fall by depth in part
        aa = ab = bb = a_da = ab_d = b_db = 0.0
        for axis in range(3):
            a0 = np.float64(geometry[at + _P[AXES] + _I(axis * CHUNK)])
            a1 = np.float64(geometry[at + _P[AXES + 3] + _I(axis * CHUNK)])
            a2 = np.float64(geometry[at + _P[AXES + 6] + _I(axis * CHUNK)])
            r = p20 * a0 + p21 * a1 + p22 * a2
            m = (p00 * a0 + p01 * a1 + p02 * a2 - ju * r) * scale
            n = (p10 * a0 + p11 * a1 + p12 * a2 - jv * r) * scale
            dm, dn = m * (1 - deeper) - dju * r * scale, n * (1 - deeper) - djv * r * scale
            aa += m * m
            ab += m * n
            bb += n * n
            a_da += m * dm
            ab_d += m * dn + n * dm
            b_db += n * dn
        pull, pull_u, pull_w = work[i + _P[PULL]], work[i + _P[PULL_U]], work[i + _P[PULL_W]]
        pull_uu, pull_uw, pull_ww = work[i + _P[PULL_UU]], work[i + _P[PULL_UW]], work[i + _P[PULL_WW]]
        f, g, h = work[i + _P[_FACTORS]], work[i + _P[_FACTORS + 1]], work[i + _P[_FACTORS + 2]]
        # 2 tr(F dΣ Fᵀ Q) as factors of da, db and dc
        by_a = 2 * f * f * pull_uu
        by_b = 4 * f * g * pull_uu + 4 * f * h * pull_uw
        by_c = 2 * g * g * pull_uu + 4 * g * h * pull_uw + 2 * h * h * pull_ww
        by_u, by_v = 2 * f * pull_u, 2 * (g * pull_u + h * pull_w)
        along_depth = by_u * du + by_v * dv + 2 * a_da * by_a + ab_d * by_b + 2 * b_db * by_c
        along_size = 2 * (aa * by_a + ab * by_b + bb * by_c)
        own = np.float64(geometry[at + _P[OWN_PIXEL]]) * view.focal * scale
        covariance, change = (aa, ab, bb), (2 * a_da, ab_d, 2 * b_db)
        wider, wider_size = _widening(own, 1 - deeper, covariance, change)
        faded, faded_size = _fading(own, 1 - deeper, covariance, change)
        by_depth = wider * (by_a + by_c) if own > 1 else faded * pull
        by_size = wider_size * (by_a + by_c) if own > 1 else faded_size * pull
        red, green, blue = work[i + _P[BY_RED]], work[i + _P[BY_RED + 1]], work[i + _P[BY_RED + 2]]
        work[i + _P[LOG_DEPTH]] = along_depth + (by_depth if own > 0 else 0.0)
        work[i + _P[LOG_SIZE]] = along_size + (by_size if own > 0 else 0.0)
        work[i + _P[LOGIT]] = pull / (1 + exp(work[i + _P[_LOGIT]]))  # the rest of the opacity, to 1
        work[i + _P[SH_RED]], work[i + _P[SH_RED + 1]], work[i + _P[SH_RED + 2]] = C0 * red, C0 * green, C0 * blue


@compiled
def _widening(
    own: Number, wider: Number, covariance: tuple[Number, Number, Number], change: tuple[Number, Number, Number]
) -> tuple[Number, Number]:
    """Change of the dilation by log depth and by log size; arguments as those of `_fading`, but `own` above 1."""
    a, b, c = covariance
    da, db, dc = change
    apart = np.sqrt((a - c) * (a - c) + 4 * b * b)
    least = (a * c - b * b) / max(0.5 * (a + c + apart), LEAST_VARIANCE)
    e = DILATION * own * own
    turned = ((a - c) * (da - dc) + 4 * b * db) / max(apart, 1e-30)  # of a circle, 0
    by_depth, by_size = 2 * e * wider - 0.5 * (da + dc - turned), -2 * least
    is_wider = e - least > DILATION
    return by_depth if is_wider else 0.0, by_size if is_wider else 0.0


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
