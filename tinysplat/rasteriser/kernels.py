"""Compositing of splats front to back and its gradient, compiled with numba for one thread.

Splats are taken in depth order and drawn over the whole picture one after the other: each touches a handful of pixels,
so lists per tile would cost more than they save. Needs the package numba.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tinysplat_runtime.render.composite import ALPHA_MAX, TRANSMITTANCE_MIN
from tinysplat_runtime.render.prepare import ALPHA_MIN

_ALPHA_MIN = np.float32(ALPHA_MIN)
_HALF = np.float32(0.5)
_ONE = np.float32(1)
_RULES = {"contract", "reassoc", "arcp", "nsz"}
"""Floating-point freedoms that leave infinities and NaN as they are."""


@njit(cache=True, nogil=True, inline="always")
def _rows(y: float, half: float, height: int) -> tuple[int, int]:
    """First and last row whose centre lies within `half` of y."""
    return max(math.ceil(y - half - _HALF), 0), min(math.floor(y + half - _HALF), height - 1)


@njit(cache=True, nogil=True, fastmath=_RULES)
def composite(
    order: NDArray,
    centres: NDArray,
    conics: NDArray,
    opacities: NDArray,
    colours: NDArray,
    image: NDArray,
    left: NDArray,
) -> None:
    """Blend splats into a picture.

    Args:
        order: (n,) int indices of splats, nearest first.
        centres: (N, 2) float32.
        conics: (N, 3) float32.
        opacities: (N,) float32.
        colours: (N, 3) float32.
        image: (H, W, 3) float32 zeros; becomes the picture.
        left: (H, W) float32 ones; becomes the transmittance.
    """
    height, width = left.shape
    open_ = np.ones((height, width), np.bool_)
    for i in order:
        x, y = centres[i, 0], centres[i, 1]
        a, b, c = conics[i, 0], conics[i, 1], conics[i, 2]
        o = opacities[i]
        reach = np.float32(2) * math.log(o / _ALPHA_MIN)
        schur = c - b * b / a
        first, last = _rows(y, math.sqrt(reach / schur), height)
        for row in range(first, last + 1):
            dy = row + _HALF - y
            rest = reach - schur * dy * dy
            if rest < 0:
                continue
            begin, end = _rows(x - b / a * dy, math.sqrt(rest / a), width)
            for column in range(begin, end + 1):
                if not open_[row, column]:
                    continue
                dx = column + _HALF - x
                alpha = min(o * math.exp(-_HALF * (a * dx * dx + c * dy * dy) - b * dx * dy), ALPHA_MAX)
                if alpha < _ALPHA_MIN:
                    continue
                before = left[row, column]
                after = before * (_ONE - alpha)
                if after < TRANSMITTANCE_MIN:
                    open_[row, column] = False
                    continue
                weight = before - after
                left[row, column] = after
                for k in range(3):
                    image[row, column, k] += weight * colours[i, k]


@njit(cache=True, nogil=True, fastmath=_RULES)
def composite_gradient(
    order: NDArray,
    centres: NDArray,
    conics: NDArray,
    opacities: NDArray,
    colours: NDArray,
    behind: NDArray,
    d_image: NDArray,
    out: NDArray,
) -> None:
    """Gradients of a loss with respect to what `composite` was given.

    A walk front to back as in `composite`: with w = αT, ∂L/∂α = T·⟨c, ∂L/∂C⟩ − (what lies behind) / (1 − α).

    Args:
        order, centres, conics, opacities, colours: as they were.
        behind: (H, W) float32 ⟨picture, ∂L/∂picture⟩ + transmittance · ∂L/∂transmittance; used up.
        d_image: (H, W, 3) float32 ∂L/∂picture.
        out: (N, 9) zeros; becomes ∂L/∂ of x, y, A, B, C, opacity, red, green, blue.
    """
    height, width = behind.shape
    left = np.ones((height, width), np.float32)
    open_ = np.ones((height, width), np.bool_)
    for i in order:
        x, y = centres[i, 0], centres[i, 1]
        a, b, c = conics[i, 0], conics[i, 1], conics[i, 2]
        o = opacities[i]
        red, green, blue = colours[i, 0], colours[i, 1], colours[i, 2]
        reach = np.float32(2) * math.log(o / _ALPHA_MIN)
        schur = c - b * b / a
        g_x = g_y = g_a = g_b = g_c = g_o = g_red = g_green = g_blue = np.float32(0)
        first, last = _rows(y, math.sqrt(reach / schur), height)
        for row in range(first, last + 1):
            dy = row + _HALF - y
            rest = reach - schur * dy * dy
            if rest < 0:
                continue
            begin, end = _rows(x - b / a * dy, math.sqrt(rest / a), width)
            for column in range(begin, end + 1):
                if not open_[row, column]:
                    continue
                dx = column + _HALF - x
                shape = math.exp(-_HALF * (a * dx * dx + c * dy * dy) - b * dx * dy)
                full = o * shape
                alpha = min(full, ALPHA_MAX)
                if alpha < _ALPHA_MIN:
                    continue
                before = left[row, column]
                after = before * (_ONE - alpha)
                if after < TRANSMITTANCE_MIN:
                    open_[row, column] = False
                    continue
                weight = before - after
                left[row, column] = after
                d0, d1, d2 = d_image[row, column, 0], d_image[row, column, 1], d_image[row, column, 2]
                along = red * d0 + green * d1 + blue * d2
                g_red += weight * d0
                g_green += weight * d1
                g_blue += weight * d2
                behind[row, column] -= weight * along
                if full > ALPHA_MAX:
                    continue
                d_alpha = before * along - behind[row, column] / (_ONE - alpha)
                g_o += d_alpha * shape
                pull = d_alpha * alpha
                g_x += pull * (a * dx + b * dy)
                g_y += pull * (b * dx + c * dy)
                g_a -= _HALF * pull * dx * dx
                g_b -= pull * dx * dy
                g_c -= _HALF * pull * dy * dy
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = g_x, g_y, g_a, g_b, g_c
        out[i, 5], out[i, 6], out[i, 7], out[i, 8] = g_o, g_red, g_green, g_blue
