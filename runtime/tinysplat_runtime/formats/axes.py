"""The axes of standards with y up, and back: SPZ, glTF and USD against .ply and OpenCV scenes, which have y down.

Half a turn about x: y and z change sign in positions, rotations and SH, so that viewers show both the same way up. It
is its own inverse. An extension of SPZ has sixteen further systems.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import sh_basis
from .placement import placed

HALF_TURN = np.array([1.0, -1.0, -1.0])
"""Signs of x, y and z."""

QUAT_SIGNS = np.array([1.0, 1.0, -1.0, -1.0])
"""Signs of w, x, y and z of a rotation about the turned axes."""


SPZ_AXES, SPZ_SYSTEMS = 4, 16
"""Number of right-up-back among the coordinate systems of SPZ's library, and the last of them."""

_QUARTER_TURN = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def sh_signs(degree: int, signs: NDArray = HALF_TURN) -> NDArray:
    """(B,) float64 factors of the coefficients: every function is even or odd where axes change sign."""
    direction = np.array([0.48, 0.6, 0.64])  # where no function up to degree 4 is zero
    return np.sign(sh_basis(direction * signs, degree) * sh_basis(direction, degree))


def half_turned(arrays: dict[str, NDArray], signs: NDArray = HALF_TURN) -> dict[str, NDArray]:
    """The same Gaussians about the other axes; arrays as `Gaussians` has them, for means (N, 3) and sh (N, B, 3)."""
    degree = int(np.sqrt(arrays["sh"].shape[-2])) - 1
    with np.errstate(invalid="ignore"):  # a NaN that signals: Gaussians will name it
        return {
            **arrays,
            "means": arrays["means"] * signs,
            "quats": arrays["quats"] * np.append(1, signs.prod() * signs),
            "sh": arrays["sh"] * sh_signs(degree, signs)[:, None],
        }


def from_spz_system(arrays: dict[str, NDArray], system: int) -> dict[str, NDArray]:
    """The same Gaussians in SPZ's own axes, out of system 1 to `SPZ_SYSTEMS`.

    Three bits of its number less one say which way x, y and z point; with the fourth, z is up and y to the front. As in
    the format's library, signs are those of the axes as stored.
    """
    differing = (system - 1) ^ (SPZ_AXES - 1)
    arrays = half_turned(arrays, np.array([-1.0 if differing >> axis & 1 else 1.0 for axis in range(3)]))
    return placed(arrays, _QUARTER_TURN) if differing >> 3 else arrays
