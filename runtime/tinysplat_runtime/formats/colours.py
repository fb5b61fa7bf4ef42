"""Colours of Gaussians from one encoding to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import C0, sh_basis, sh_degree, spread_directions
from ..scene.colours import encoded_srgb

_DIRECTIONS = 64  # of degree 3 and below, well spread ones tell all
_ROWS = 1 << 14  # Gaussians at a time


def srgb_of_linear(sh: NDArray) -> NDArray:
    """Coefficients (N, B, 3) float64 whose colours are about those of linear BT.709 ones, encoded as sRGB.

    Exact at degree 0. Above, they are fitted to the encoded colours of many directions, which are no polynomial.
    """
    sh = sh.astype(np.float64)
    if sh.shape[1] == 1:
        return (encoded_srgb((0.5 + C0 * sh).clip(0)) - 0.5) / C0
    basis = sh_basis(spread_directions(_DIRECTIONS), sh_degree(sh.shape[1]))
    back = np.linalg.pinv(basis)
    fitted = np.empty_like(sh)
    for start in range(0, len(sh), _ROWS):
        rows = slice(start, start + _ROWS)
        fitted[rows] = back @ (encoded_srgb((0.5 + basis @ sh[rows]).clip(0)) - 0.5)
    return fitted
