"""Colours of Gaussians from one encoding to another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0, sh_basis, sh_degree

_DIRECTIONS = 64  # of degree 3 and below, well spread ones tell all
_ROWS = 1 << 14  # Gaussians at a time


def srgb_of_linear(sh: NDArray) -> NDArray:
    """Coefficients (N, B, 3) float64 whose colours are about those of linear BT.709 ones, encoded as sRGB.

    Exact at degree 0. Above, they are fitted to the encoded colours of many directions, which are no polynomial.
    """
    sh = sh.astype(np.float64)
    if sh.shape[1] == 1:
        return (_encoded(0.5 + C0 * sh) - 0.5) / C0
    n = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1 - 2 * n / _DIRECTIONS, math.pi * (1 + math.sqrt(5)) * n  # Fibonacci's lattice
    across = np.sqrt(1 - z * z)
    basis = sh_basis(np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=-1), sh_degree(sh.shape[1]))
    back = np.linalg.pinv(basis)
    fitted = np.empty_like(sh)
    for start in range(0, len(sh), _ROWS):
        rows = slice(start, start + _ROWS)
        fitted[rows] = back @ (_encoded(0.5 + basis @ sh[rows]) - 0.5)
    return fitted


def _encoded(colours: NDArray) -> NDArray:
    """Linear colours as sRGB (IEC 61966-2-1) has them, from 0 on."""
    colours = colours.clip(0)
    return np.where(colours <= 0.0031308, 12.92 * colours, 1.055 * colours ** (1 / 2.4) - 0.055)
