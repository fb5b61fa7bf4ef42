"""Projection as compiled code: the arithmetic of `project.py`, a chunk of 128 Gaussians at a time.

The numbers of a chunk lie plane by plane at constant distances in one array. That is what lets the compiler make vector
instructions of these loops, as it could not tell whether a dozen arrays overlap; and the planes of a chunk are
neighbours in memory, as columns a power of two apart would evict each other from the cache (SH of degree 3: 1.5 in
place of 5 ms for 131,072 Gaussians). Scratch stays in a core's L1 cache from step to step.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0, band_1, band_2, band_3, band_4
from ..system.kernels_compile import Number, compiled, within
from .prepare import ALPHA_MIN
from .project import DILATION, LEAST_OWN_PIXEL, LEAST_VARIANCE, LIMIT, MARGIN_PX, WIDE_PX

CHUNK = 128

RECORD = 16
"""Floats in a splat's record: 64 bytes, so that picking one misses the cache once."""

X, Y, ALPHA_X, BETA_X, GAMMA, LOG_OPACITY, RED, GREEN, BLUE, DEPTH, LEFT, RIGHT, TOP, BOTTOM, REACH, LAST = range(16)
"""Columns of a record: pixel of the mean, the exponent's factors, colour, depth, first and last column and row of
pixels (RIGHT < 0: not visible), 1/αx where `CHORD_PX` says so and else 0; the last tells whether float32 is too narrow,
and then how much is drawn in front (`kernels_blend.composite_tile`)."""

GEOMETRY = 14
"""Planes of a chunk: means (3), principal axes (9, row by row), log opacity, own pixel (0 for none, negative
of a list)."""

MEAN, AXES, OPACITY, OWN_PIXEL = 0, 3, 12, 13
"""Where in `GEOMETRY` they begin."""

Three = tuple[float, float, float]


class ViewNumbers(NamedTuple):
    """A view as float64 numbers; see `project.View`.

    Attributes:
        offset: what means need to be relative to the camera's centre.
        principal: pixel of the principal point.
        least, greatest: the Jacobian's limits, pixels from the principal point.
        right, down, ahead: rows of the projection.
        near_plane: scene units.
        width, height: pixels.
        focal: length, pixels.
    """

    offset: Three
    principal: tuple[float, float]
    least: tuple[float, float]
    greatest: tuple[float, float]
    right: Three
    down: Three
    ahead: Three
    near_plane: float
    width: float
    height: float
    focal: float


CHORD_PX = 16
"""Footprints at least this wide are cut to their chord in every row; narrower ones save nothing by it."""

_BAND_1, _BAND_2, _BAND_3, _BAND_4 = (within(band) for band in (band_1, band_2, band_3, band_4))

_F, _I = np.float32, np.uint64
_HALF, _ONE, _TWO, _FOUR, _LIMIT, _WIDE = _F(0.5), _F(1), _F(2), _F(4), _F(LIMIT), _F(WIDE_PX)
_DILATION, _LEAST_OWN, _MOST_OWN = _F(DILATION), _F(LEAST_OWN_PIXEL), _F(math.sqrt(LIMIT))
_LEAST_VARIANCE = _F(LEAST_VARIANCE)
_LOG_ALPHA_MIN = _F(math.log(ALPHA_MIN))
_BEFORE, _BEHIND = _F(0.5 + MARGIN_PX), _F(0.5 - MARGIN_PX)

# Planes lie at unsigned distances: a signed index might be negative and count from the end, which no vector can.
P = tuple(_I(CHUNK * plane) for plane in range(RECORD + 25 + 5))
_BASIS = RECORD
_SIZE = RECORD + 25  # scratch: half width and height per √τ, direction
SCRATCH = CHUNK * len(P)


@compiled
def project(
    geometry: NDArray, sh: NDArray, view: ViewNumbers, work: NDArray, records: NDArray, rows: NDArray
) -> tuple[Number, Number]:
    """Project a block into records.

    Args:
        geometry: (chunks·14·128,) float32.
        sh: (chunks, 3 S·128) float32.
        view: where the picture is taken.
        work: (`SCRATCH`,) float32.
        records: (chunks·128, 16) float32, written.
        rows: (chunks·128,) int32, written: of which Gaussian of the block each record is. Then there are records of
            those alone that may show, and memory that nothing touches is none. Where empty, every Gaussian has its own.

    Returns:
        How many records there are, and how many of them are too wide for float32 and need to be done again.
    """
    count, wide = 0, 0
    for chunk in range(len(sh)):
        start = _I(chunk) * _I(GEOMETRY * CHUNK)
        _shapes(geometry, start, view, work)
        _fade(geometry, start, work)
        shown, is_wide = _bounds(geometry, start, view, work)
        wide += is_wide
        if shown + is_wide:
            _directions(geometry, start, view, work)
            _colours(sh[chunk], work)
        for row in range(CHUNK):
            i = _I(row)
            if rows.size:
                if not (work[i + P[RIGHT]] >= _F(0) or work[i + P[LAST]] > _F(0)):
                    continue
                rows[count] = chunk * CHUNK + row
            for plane in range(RECORD):
                records[count, plane] = work[_I(plane * CHUNK) + i]
            count += 1
    return count, wide


@within
def _shapes(geometry: NDArray, start: Number, view: ViewNumbers, work: NDArray) -> None:
    """Pixel, factors of the exponent, extents and depth (−1 before the near plane), and the square of the share of its
    opacity that is left; see `project.py`."""
    (ox, oy, oz), (cx, cy), near, focal = view.offset, view.principal, view.near_plane, view.focal
    (min_u, min_v), (max_u, max_v) = view.least, view.greatest
    (p00, p01, p02), (p10, p11, p12), (p20, p21, p22) = view.right, view.down, view.ahead
    for lane in range(CHUNK):
        i = _I(lane)
        at = start + i
        x, y, z = geometry[at] + ox, geometry[at + P[1]] + oy, geometry[at + P[2]] + oz
        depth = p20 * x + p21 * y + p22 * z
        u, v = (p00 * x + p01 * y + p02 * z) / depth, (p10 * x + p11 * y + p12 * z) / depth
        work[i], work[i + P[Y]] = _F(u + cx), _F(v + cy)
        work[i + P[DEPTH]] = _F(min(depth, LIMIT)) if depth > near else _F(-1)
        # Rows of J·W, in float32 from here
        u, v, s = _F(clipped(u, min_u, max_u)), _F(clipped(v, min_v, max_v)), _F(1 / depth)
        j0, j1, j2 = (_F(p00) - u * _F(p20)) * s, (_F(p01) - u * _F(p21)) * s, (_F(p02) - u * _F(p22)) * s
        k0, k1, k2 = (_F(p10) - v * _F(p20)) * s, (_F(p11) - v * _F(p21)) * s, (_F(p12) - v * _F(p22)) * s
        a0, a1, a2 = geometry[at + P[AXES]], geometry[at + P[AXES + 1]], geometry[at + P[AXES + 2]]
        b0, b1, b2 = geometry[at + P[AXES + 3]], geometry[at + P[AXES + 4]], geometry[at + P[AXES + 5]]
        c0, c1, c2 = geometry[at + P[AXES + 6]], geometry[at + P[AXES + 7]], geometry[at + P[AXES + 8]]
        m0, m1, m2 = j0 * a0 + j1 * b0 + j2 * c0, j0 * a1 + j1 * b1 + j2 * c1, j0 * a2 + j1 * b2 + j2 * c2
        n0, n1, n2 = k0 * a0 + k1 * b0 + k2 * c0, k0 * a1 + k1 * b1 + k2 * c1, k0 * a2 + k1 * b2 + k2 * c2
        own_pixel = clipped(abs(geometry[at + P[OWN_PIXEL]]) * _F(focal) * s, _LEAST_OWN, _MOST_OWN)
        own = _DILATION * own_pixel * own_pixel
        own = own if geometry[at + P[OWN_PIXEL]] > _F(0) else max(own, _DILATION)
        width, height = m0 * m0 + m1 * m1 + m2 * m2, n0 * n0 + n1 * n1 + n2 * n2
        b, across = m0 * n0 + m1 * n1 + m2 * n2, width - height
        d0, d1, d2 = m0 * n1 - n0 * m1, m1 * n2 - n1 * m2, m2 * n0 - n2 * m0
        cross = d0 * d0 + d1 * d1 + d2 * d2
        largest = _HALF * (width + height + math.sqrt(across * across + _FOUR * b * b))
        dilation = max(own - cross / max(largest, _LEAST_VARIANCE), _DILATION)
        a, c = width + dilation, height + dilation
        det = dilation * (width + height + dilation) + cross
        work[i + P[LOG_OPACITY]] = (own * (width + height + own) + cross) / det if own < dilation else _ONE
        alpha_x = math.sqrt(_HALF * c / det)
        work[i + P[ALPHA_X]], work[i + P[BETA_X]], work[i + P[GAMMA]] = (
            alpha_x,
            -alpha_x * (b / c),
            math.sqrt(_HALF / c),
        )
        work[i + P[_SIZE]], work[i + P[_SIZE + 1]] = math.sqrt(_TWO * a), math.sqrt(_TWO * c)


@within
def _fade(geometry: NDArray, start: Number, work: NDArray) -> None:
    """Opacities, from the shares of their squares that `_shapes` leaves in their place; no vector has a logarithm."""
    for lane in range(CHUNK):
        i = _I(lane)
        share, log_opacity = work[i + P[LOG_OPACITY]], geometry[start + i + P[OPACITY]]
        work[i + P[LOG_OPACITY]] = log_opacity + _HALF * math.log(share) if share < _ONE else log_opacity


@within
def clipped(value: Number, low: Number, high: Number) -> Number:
    """A number within limits; NaN is the lower limit. Two choices, as a vector instruction makes them."""
    value = value if value > low else low  # noqa: FURB136  # NaN becomes low, which max() does not promise
    return value if value < high else high  # noqa: FURB136


@within
def _bounds(geometry: NDArray, start: Number, view: ViewNumbers, work: NDArray) -> tuple[Number, Number]:
    """Columns and rows of pixels that footprints may reach; counts of those that show and of those too wide."""
    width, height = _F(view.width), _F(view.height)
    shown, wide = 0, 0
    for lane in range(CHUNK):
        i = _I(lane)
        log_opacity, x, y = work[i + P[LOG_OPACITY]], work[i], work[i + P[Y]]
        root = math.sqrt(log_opacity - _LOG_ALPHA_MIN)
        half_width, half_height = work[i + P[_SIZE]], work[i + P[_SIZE + 1]]
        across, down = half_width * root, half_height * root
        left = np.ceil(clipped(x - across - _BEFORE, _F(0), width))
        right = np.floor(clipped(x + across - _BEHIND, _F(-1), width - _ONE))
        top = np.ceil(clipped(y - down - _BEFORE, _F(0), height))
        bottom = np.floor(clipped(y + down - _BEHIND, _F(-1), height - _ONE))
        in_front = work[i + P[DEPTH]] > _F(0)
        is_wide = in_front & (not half_width + half_height < _WIDE)
        shows = in_front & (left <= right) & (top <= bottom)
        work[i + P[LEFT]], work[i + P[TOP]], work[i + P[BOTTOM]] = left, top, bottom
        work[i + P[RIGHT]] = right if shows else _F(-1)
        work[i + P[REACH]] = _ONE / work[i + P[ALPHA_X]] if right - left >= _F(CHORD_PX) else _F(0)
        work[i + P[LAST]] = _F(is_wide)
        shown += shows
        wide += is_wide
    return shown, wide


@within
def _directions(geometry: NDArray, start: Number, view: ViewNumbers, work: NDArray) -> None:
    """Unit vectors from the camera centre to the means."""
    ox, oy, oz = view.offset
    for lane in range(CHUNK):
        i = _I(lane)
        at = start + i
        x, y, z = geometry[at] + ox, geometry[at + P[1]] + oy, geometry[at + P[2]] + oz
        norm = 1 / math.sqrt(x * x + y * y + z * z)
        work[i + P[_SIZE + 2]], work[i + P[_SIZE + 3]] = _F(x * norm), _F(y * norm)
        work[i + P[_SIZE + 4]] = _F(z * norm)


@within
def _colours(sh: NDArray, work: NDArray) -> None:
    """clamp(0.5 + Σ_b Y_b(d)·sh_b, 0)."""
    functions = sh.size // (3 * CHUNK)
    for lane in range(CHUNK):
        work[_I(lane) + P[_BASIS]] = _F(C0)
    _basis(functions, work)
    for plane in (RED, GREEN, BLUE):
        for lane in range(CHUNK):
            work[_I(lane) + P[plane]] = _HALF
    for function in range(functions):
        y, at = P[_BASIS + function], _I(3 * CHUNK * function)
        for lane in range(CHUNK):
            i = _I(lane)
            work[i + P[RED]] += work[i + y] * sh[at + i]
            work[i + P[GREEN]] += work[i + y] * sh[at + i + P[1]]
            work[i + P[BLUE]] += work[i + y] * sh[at + i + P[2]]
    for plane in (RED, GREEN, BLUE):
        for lane in range(CHUNK):
            i = _I(lane) + P[plane]
            work[i] = clipped(work[i], _F(0), _LIMIT)  # NaN, which coefficients near float32's end can sum to, is 0


@within
def _basis(functions: Number, work: NDArray) -> None:
    """The basis functions of degree 1 and up at the directions; a loop each, as a loop with branches is no vector's."""
    x, y, z = P[_SIZE + 2], P[_SIZE + 3], P[_SIZE + 4]
    if functions > 1:
        for lane in range(CHUNK):
            i = _I(lane)
            y0, y1, y2 = _BAND_1(work[i + x], work[i + y], work[i + z])
            work[i + P[_BASIS + 1]], work[i + P[_BASIS + 2]], work[i + P[_BASIS + 3]] = _F(y0), _F(y1), _F(y2)
    if functions > 4:
        for lane in range(CHUNK):
            i = _I(lane)
            d, e, f = work[i + x], work[i + y], work[i + z]
            y0, y1, y2, y3, y4 = _BAND_2(d, e, f, d * d, e * e, f * f)
            work[i + P[_BASIS + 4]], work[i + P[_BASIS + 5]], work[i + P[_BASIS + 6]] = _F(y0), _F(y1), _F(y2)
            work[i + P[_BASIS + 7]], work[i + P[_BASIS + 8]] = _F(y3), _F(y4)
    if functions > 9:
        for lane in range(CHUNK):
            i = _I(lane)
            d, e, f = work[i + x], work[i + y], work[i + z]
            y0, y1, y2, y3, y4, y5, y6 = _BAND_3(d, e, f, d * d, e * e, f * f)
            work[i + P[_BASIS + 9]], work[i + P[_BASIS + 10]], work[i + P[_BASIS + 11]] = _F(y0), _F(y1), _F(y2)
            work[i + P[_BASIS + 12]], work[i + P[_BASIS + 13]], work[i + P[_BASIS + 14]] = _F(y3), _F(y4), _F(y5)
            work[i + P[_BASIS + 15]] = _F(y6)
    if functions > 16:
        for lane in range(CHUNK):
            i = _I(lane)
            d, e, f = work[i + x], work[i + y], work[i + z]
            y0, y1, y2, y3, y4, y5, y6, y7, y8 = _BAND_4(d, e, f, d * d, e * e, f * f)
            work[i + P[_BASIS + 16]], work[i + P[_BASIS + 17]], work[i + P[_BASIS + 18]] = _F(y0), _F(y1), _F(y2)
            work[i + P[_BASIS + 19]], work[i + P[_BASIS + 20]], work[i + P[_BASIS + 21]] = _F(y3), _F(y4), _F(y5)
            work[i + P[_BASIS + 22]], work[i + P[_BASIS + 23]], work[i + P[_BASIS + 24]] = _F(y6), _F(y7), _F(y8)
