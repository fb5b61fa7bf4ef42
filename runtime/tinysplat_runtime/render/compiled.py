"""Compiled compositing, chosen where numba is installed (`tinysplat[fast]`): the same pictures, several times as fast.

The definition is that of `composite.py`; projection and depth order are shared with it. What differs is the way: the
image is cut into bands of rows, and a band takes the splats in depth order, one row of one splat at a time, eight
pixels to a vector instruction. Where numpy needs lists of splats per tile to have long arrays, a loop needs none.

This module alone imports numba, so that it may be missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .composite import ALPHA_MAX, N_COLOUR, TRANSMITTANCE_MIN
from .prepare import ALPHA_MIN, BLOCK_SIZE
from .project import ALPHA_X, BETA_X, BLUE, GAMMA, GREEN, MARGIN_PX, RED, WIDE_PX, Splats, X, Y
from .tiles import WIDE_MARGIN

BANDS = 16
"""Most bands of an image: enough for threads to share them evenly, few enough that each may look at every splat."""

LANES = 8
"""Pixels blended together: the floats of a 32-byte vector."""

_PLANES = 2 + N_COLOUR  # transmittance, red, green, blue, Σ w·z
_F = np.float32
_ALPHA_MIN, _ALPHA_MAX, _LOG_ALPHA_MIN = _F(ALPHA_MIN), _F(ALPHA_MAX), _F(math.log(ALPHA_MIN))
_RED, _GREEN, _BLUE, _DEPTH = (np.uint64(plane * LANES) for plane in range(1, _PLANES))
_HALF, _MARGIN, _WIDE, _WIDER = _F(0.5), _F(MARGIN_PX), _F(WIDE_PX), _F(WIDE_MARGIN)

Number = Any  # numba infers what kind when it compiles

# A product and a sum may become one instruction; nothing else of "fast math" is safe with infinities about.
_compile = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})


class Canvas:
    """What every pixel has gathered.

    Attributes:
        state: (H, groups, 5, 8) float32: transmittance, red, green, blue, Σ w·z of groups of eight pixels. The
            transmittance of a pixel that has stopped is negative. Planes of a group lie at constant distances from
            each other, without which the compiler could not tell that writing one leaves the others alone.
    """

    def __init__(self, height: int, width: int) -> None:
        self.width = width
        self.state = np.zeros((height, -(-width // LANES), _PLANES, LANES), np.float32)
        self.state[:, :, 0] = 1

    def _image(self, planes: slice) -> NDArray:
        picked = self.state[:, :, planes].swapaxes(2, 3)
        return picked.reshape(len(picked), -1, picked.shape[-1])[:, : self.width]

    def colours(self) -> NDArray:
        """(H, W, 3) what the splats add."""
        return self._image(slice(1, 1 + N_COLOUR))

    def transmittance(self) -> NDArray:
        """(H, W) what the splats let through."""
        return np.abs(self._image(slice(0, 1))[..., 0])

    def depths(self) -> tuple[NDArray, NDArray]:
        """(H, W) each: Σ w·z, and Σ w."""
        return self._image(slice(1 + N_COLOUR, None))[..., 0], np.float32(1) - self.transmittance()


def composite(splats: Splats, order: NDArray, height: int, width: int, run_jobs: Callable) -> Canvas:
    """Blend splats into a picture.

    Args:
        splats: the frame's splats.
        order: (R,) int64 rows of the visible ones, nearest first.
        height, width: of the picture.
        run_jobs: maps a function over a list, perhaps on several threads.
    """
    canvas = Canvas(height, width)
    rows = np.empty((2, order.size), np.int32)

    def find_rows(start: int) -> None:
        part = slice(start, start + BLOCK_SIZE)
        _rows(splats.records, splats.log_opacities, order[part], height, rows[:, part])

    run_jobs(find_rows, range(0, order.size, BLOCK_SIZE))
    band = -(-height // BANDS)

    def blend(first: int) -> None:
        state = canvas.state[first : first + band]
        mine = np.flatnonzero((rows[0] < first + len(state)) & (rows[1] >= first))
        _blend(splats.records, splats.log_opacities, splats.depths, order[mine], rows[:, mine], first, width, state)

    run_jobs(blend, range(0, height, band))
    return canvas


@_compile
def _rows(records: NDArray, log_opacities: NDArray, order: NDArray, height: Number, out: NDArray) -> None:
    """First and last row of pixels that each footprint may reach, into `out` (2, R)."""
    for entry in range(order.size):
        splat = order[entry]
        y, gamma = records[splat, Y], records[splat, GAMMA]
        reach = math.sqrt(log_opacities[splat] - _LOG_ALPHA_MIN + _WIDER) / gamma + _MARGIN
        out[0, entry] = _clipped(np.ceil(y - reach - _HALF), 0, height)
        out[1, entry] = _clipped(np.floor(y + reach - _HALF), -1, height - 1)


@_compile
def _clipped(value: Number, low: Number, high: Number) -> Number:
    """A whole number within limits; infinities are, too, and NaN is the lower limit."""
    return high if value > high else (int(value) if value > low else low)


@_compile
def _exp(x: Number) -> Number:
    """e^x for x in [−80, 88] to two units in the last place, as arithmetic that vectorises (Cephes' expf)."""
    biased = np.int32(x * _F(1.44269504) + _F(127.5))  # the nearest power of two, and 127
    whole = _F(biased) - _F(127)
    r = x - whole * _F(0.693359375) + whole * _F(2.12194440e-4)
    p = _F(1.9875691500e-4)
    p = p * r + _F(1.3981999507e-3)
    p = p * r + _F(8.3334519073e-3)
    p = p * r + _F(4.1665795894e-2)
    p = p * r + _F(1.6666665459e-1)
    p = p * r + _F(5.0000001201e-1)
    return (p * r * r + r + _F(1)) * np.int32(biased << np.int32(23)).view(np.float32)


@_compile
def _blend(
    records: NDArray,
    log_opacities: NDArray,
    depths: NDArray,
    order: NDArray,
    rows: NDArray,
    first: Number,
    width: Number,
    state: NDArray,
) -> None:
    """Blend splats into the rows of one band, `state` (h, groups, 5, 8), whose first row is `first`."""
    groups, flat = state.shape[1], state.reshape(-1)
    last = first + state.shape[0] - 1
    for entry in range(order.size):
        splat = order[entry]
        x, y, alpha_x, beta_x, gamma = (
            records[splat, X], records[splat, Y], records[splat, ALPHA_X], records[splat, BETA_X], records[splat, GAMMA]
        )  # fmt: skip
        colour = records[splat, RED], records[splat, GREEN], records[splat, BLUE]
        tau, reach = log_opacities[splat] - _LOG_ALPHA_MIN, _F(1) / alpha_x
        half_width = math.sqrt(beta_x * beta_x + gamma * gamma) * reach / gamma
        is_wide = not half_width + _F(1) / gamma < _WIDE  # beyond float32: take whole rows
        half = _F(np.inf) if is_wide else half_width * math.sqrt(tau) + _MARGIN
        left, right = _columns(x, half, width)
        has_chords = right - left >= 2 * LANES and not is_wide  # narrower ones save nothing by them
        for row in range(max(first, rows[0, entry]), min(last, rows[1, entry]) + 1):
            dy = _F(row) + _HALF - y
            fall = gamma * dy * (gamma * dy)
            if has_chords:
                if fall > tau:
                    continue
                left, right = _columns(x - beta_x * dy * reach, math.sqrt(tau - fall) * reach + _MARGIN, width)
            for group in range(left // LANES, right // LANES + 1 if left <= right else 0):
                across = alpha_x * (_F(group * LANES) + _HALF - x) + beta_x * dy
                # Unsigned, as a signed index might be negative and count from the end, which no vector can.
                start = np.uint64(((row - first) * groups + group) * (_PLANES * LANES))
                _blend_group(flat, start, across, alpha_x, log_opacities[splat] - fall, colour, depths[splat])


@_compile
def _columns(middle: Number, half: Number, width: Number) -> tuple[Number, Number]:
    """First and last column of pixels whose centres lie within `half` of `middle`."""
    first = _clipped(np.ceil(middle - half - _HALF), 0, width)
    return first, _clipped(np.floor(middle + half - _HALF), -1, width - 1)


@_compile
def _blend_group(
    pixels: NDArray,
    start: Number,
    across: Number,
    alpha_x: Number,
    exponent: Number,
    colour: tuple[Number, Number, Number],
    depth: Number,
) -> None:
    """Blend one splat into the eight pixels whose planes begin at `start`; free of branches, so that it vectorises."""
    red, green, blue = colour
    for lane in range(LANES):
        at = start + np.uint64(lane)
        u = across + alpha_x * _F(lane)
        alpha = min(_exp(max(exponent - u * u, _F(-80))), _ALPHA_MAX)
        before = pixels[at]
        weight = alpha * max(before, _F(0)) if alpha >= _ALPHA_MIN else _F(0)
        after = before - weight
        stops = (after < TRANSMITTANCE_MIN) & (weight > _F(0))
        weight = _F(0) if stops else weight
        pixels[at] = -before if stops else after
        pixels[at + _RED] += weight * red
        pixels[at + _GREEN] += weight * green
        pixels[at + _BLUE] += weight * blue
        pixels[at + _DEPTH] += weight * depth
