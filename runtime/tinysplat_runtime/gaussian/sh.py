"""Real spherical harmonics of degree 0 to 4, in the order and with the signs of 3D Gaussian Splatting.

The basis function of degree l and order m = -l … l stands at index l² + l + m. Colour of a Gaussian seen along the
unit vector d from the camera centre to its mean: clamp(0.5 + Σ_b Y_b(d)·sh_b, 0).
"""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

MAX_SH_DEGREE = 4

C0 = 0.5 * math.sqrt(1 / math.pi)  # the constant function; colour = 0.5 + C0·sh for degree 0
_C1 = math.sqrt(3 / (4 * math.pi))
_C2 = (0.5 * math.sqrt(15 / math.pi), 0.25 * math.sqrt(5 / math.pi), 0.25 * math.sqrt(15 / math.pi))
_C3 = (
    0.25 * math.sqrt(35 / (2 * math.pi)),
    0.5 * math.sqrt(105 / math.pi),
    0.25 * math.sqrt(21 / (2 * math.pi)),
    0.25 * math.sqrt(7 / math.pi),
    0.25 * math.sqrt(105 / math.pi),
)
_C4 = (
    0.75 * math.sqrt(35 / math.pi),
    0.75 * math.sqrt(35 / (2 * math.pi)),
    0.75 * math.sqrt(5 / math.pi),
    0.75 * math.sqrt(5 / (2 * math.pi)),
    3 / 16 * math.sqrt(1 / math.pi),
    3 / 8 * math.sqrt(5 / math.pi),
    3 / 16 * math.sqrt(35 / math.pi),
)


def sh_degree(n_functions: int) -> int:
    """Degree whose basis has `n_functions` = (degree + 1)² functions; InputError for any other number."""
    degree = math.isqrt(max(n_functions, 0)) - 1
    if degree not in range(MAX_SH_DEGREE + 1) or (degree + 1) ** 2 != n_functions:
        raise InputError(f"sh: {n_functions} basis functions; accepted are 1, 4, 9, 16 or 25 (degree 0 to 4)")
    return degree


def resized_sh(sh: NDArray, functions: int) -> NDArray:
    """Coefficients (…, B, 3) of so many functions: the last are left out, or new ones 0."""
    kept = sh[..., :functions, :]
    lacking = functions - kept.shape[-2]
    return np.pad(kept, [(0, 0)] * (sh.ndim - 2) + [(0, lacking), (0, 0)]) if lacking else kept


Number: TypeAlias = Any
"""A float, an array or a tensor, or what numba makes of one."""


def band_1(x: Number, y: Number, z: Number) -> tuple[Number, ...]:
    """The three functions of degree 1 at the unit vector (x, y, z)."""
    return -_C1 * y, _C1 * z, -_C1 * x


def band_2(x: Number, y: Number, z: Number, xx: Number, yy: Number, zz: Number) -> tuple[Number, ...]:
    """The five of degree 2; xx, yy and zz are the squares of x, y and z."""
    return (
        2 * _C2[2] * (x * y),
        -2 * _C2[2] * (y * z),
        _C2[1] * (2 * zz - xx - yy),
        -2 * _C2[2] * (x * z),
        _C2[2] * (xx - yy),
    )


def band_3(x: Number, y: Number, z: Number, xx: Number, yy: Number, zz: Number) -> tuple[Number, ...]:
    """The seven of degree 3."""
    return (
        -_C3[0] * y * (3 * xx - yy),
        _C3[1] * (x * y) * z,
        -_C3[2] * y * (4 * zz - xx - yy),
        _C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
        -_C3[2] * x * (4 * zz - xx - yy),
        _C3[4] * z * (xx - yy),
        -_C3[0] * x * (xx - 3 * yy),
    )


def band_4(x: Number, y: Number, z: Number, xx: Number, yy: Number, zz: Number) -> tuple[Number, ...]:
    """The nine of degree 4."""
    return (
        _C4[0] * (x * y) * (xx - yy),
        -_C4[1] * (y * z) * (3 * xx - yy),
        _C4[2] * (x * y) * (7 * zz - 1),
        -_C4[3] * (y * z) * (7 * zz - 3),
        _C4[4] * (zz * (35 * zz - 30) + 3),
        -_C4[3] * (x * z) * (7 * zz - 3),
        _C4[5] * (xx - yy) * (7 * zz - 1),
        -_C4[1] * (x * z) * (xx - 3 * yy),
        _C4[6] * (xx * (xx - 3 * yy) - yy * (3 * xx - yy)),
    )


def sh_terms(x: Number, y: Number, z: Number, degree: int) -> list[Number]:
    """The (degree + 1)² basis functions of the unit vector (x, y, z), constant function left out (it is `C0`).

    Arithmetic only, so that the same formulas serve numpy arrays, torch tensors and compiled code.
    """
    terms: list[Number] = []
    if degree >= 1:
        terms += band_1(x, y, z)
    if degree >= 2:
        squares = x * x, y * y, z * z
        for band in (band_2, band_3, band_4)[: degree - 1]:
            terms += band(x, y, z, *squares)
    return terms


def spread_directions(count: int) -> NDArray:
    """(n, 3) float64 unit vectors, as evenly spread as a Fibonacci lattice is."""
    i = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1 - 2 * i / count), np.pi * (1 + 5**0.5) * i
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)


def sh_basis(directions: NDArray, degree: int) -> NDArray:
    """Evaluate the basis.

    Args:
        directions: (…, 3) unit vectors, world frame.
        degree: 0 to 4.

    Returns:
        (…, (degree + 1)²) in the dtype of `directions`.
    """
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    functions: Sequence[NDArray] = [np.full_like(x, C0), *sh_terms(x, y, z, degree)]
    return np.stack(functions, axis=-1)
