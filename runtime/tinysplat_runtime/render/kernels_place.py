"""Gaussians where the values that refinement changes put them, as compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..system.kernels_compile import Number, compiled
from .kernels_project import AXES, CHUNK, GEOMETRY, MEAN, OPACITY, OWN_PIXEL

VALUES = 6
"""Of a Gaussian: log of its depth against where it began, log of its size likewise, logit of its opacity, and the red,
green and blue coefficient of SH degree 0. Means stay on the rays of their pixels; a Gaussian that moves away grows with
its distance, so that its own camera sees it as large as before."""

LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED, SH_GREEN, SH_BLUE = range(VALUES)

BASE = 13
"""Planes of a chunk of what does not change: ray from the own camera's centre (3), principal axes (9), own pixel."""

_F, _I = np.float32, np.uint64
_MEAN, _AXES, _OPACITY, _OWN_PIXEL = (_I(plane * CHUNK) for plane in (MEAN, AXES, OPACITY, OWN_PIXEL))
_BASE_AXES, _BASE_OWN_PIXEL = _I(3 * CHUNK), _I(12 * CHUNK)


@compiled
def place(base: NDArray, centre: NDArray, values: NDArray, first: int, geometry: NDArray, sh: NDArray) -> None:
    """Put a block's Gaussians where their values say, a plane of a chunk at a time, which vectorises.

    Args:
        base: (chunks, 13, 128) float32.
        centre: (3,) float64, of the own camera, relative to the Gaussians' origin.
        values: (6, rows) float32.
        first: the block's first row of them.
        geometry: (chunks, 14, 128) float32, written; see `kernels_project.project`.
        sh: (chunks, 3 S·128) float32, whose coefficients of degree 0 are written.
    """
    log_depths, log_sizes, ray, out = values[LOG_DEPTH], values[LOG_SIZE], base.ravel(), geometry.ravel()
    away, grown = np.empty(CHUNK, np.float64), np.empty(CHUNK, np.float32)
    for chunk in range(len(base)):
        row, at, to = _I(first + chunk * CHUNK), _I(chunk * BASE * CHUNK), _I(chunk * GEOMETRY * CHUNK)
        for lane in range(CHUNK):
            i = _I(lane)
            log_depth = np.float64(log_depths[row + i])
            away[i] = exp(log_depth)
            grown[i] = _F(exp(log_depth + np.float64(log_sizes[row + i])))
        for axis in range(3):
            start = centre[axis]
            for lane in range(CHUNK):
                i, plane = _I(lane), _I(axis * CHUNK)
                out[to + _MEAN + plane + i] = _F(start + away[i] * ray[at + plane + i])
        for entry in range(9):
            for lane in range(CHUNK):
                i, plane = _I(lane), _I(entry * CHUNK)
                out[to + _AXES + plane + i] = grown[i] * ray[at + _BASE_AXES + plane + i]
        for lane in range(CHUNK):
            i = _I(lane)
            out[to + _OWN_PIXEL + i] = _F(away[i] * ray[at + _BASE_OWN_PIXEL + i])
    place_looks(values[LOGIT:], first, geometry, sh)


@compiled
def place_looks(looks: NDArray, first: int, geometry: NDArray, sh: NDArray) -> None:
    """Give a block's Gaussians the opacities and colours that their values say.

    Args:
        looks: (1 + n, rows) float32: logits, and the first n planes of `sh`, three or more.
        first, geometry, sh: as `place` has them.
    """
    logits, out, colours = looks[0], geometry.ravel(), sh.ravel()
    for chunk in range(len(sh)):
        row, to = _I(first + chunk * CHUNK), _I(chunk * GEOMETRY * CHUNK)
        for lane in range(CHUNK):
            out[to + _OPACITY + _I(lane)] = _F(log_sigmoid(np.float64(logits[row + _I(lane)])))
        for number in range(len(looks) - 1):
            colour, plane = looks[1 + number], _I(chunk * sh.shape[1] + number * CHUNK)
            for lane in range(CHUNK):
                colours[plane + _I(lane)] = colour[row + _I(lane)]


@compiled
def exp(x: Number) -> Number:
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


@compiled
def log_sigmoid(x: Number) -> Number:
    """log(1 / (1 + e^−x)), float64 to a billionth: 1 + e^−|x| by the series of 2 artanh(s), s at most 1/3."""
    t = exp(-abs(x))
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
