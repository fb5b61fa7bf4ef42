"""The axes of standards with y up, and back: SPZ, glTF and USD against .ply and OpenCV scenes, which have y down.

Half a turn about x: y and z change sign in positions, rotations and SH, so that viewers show both the same way up. It
is its own inverse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..gaussian.sh import sh_basis

HALF_TURN = np.array([1.0, -1.0, -1.0])
"""Signs of x, y and z."""

QUAT_SIGNS = np.array([1.0, 1.0, -1.0, -1.0])
"""Signs of w, x, y and z of a rotation about the turned axes."""


def sh_signs(degree: int) -> NDArray:
    """(B,) float64 factors of the coefficients: every function is even or odd under the half turn."""
    direction = np.array([0.48, 0.6, 0.64])  # where no function up to degree 4 is zero
    return np.sign(sh_basis(direction * HALF_TURN, degree) * sh_basis(direction, degree))


def half_turned(arrays: dict[str, NDArray]) -> dict[str, NDArray]:
    """The same Gaussians about the other axes; arrays as `Gaussians` has them, for means (N, 3) and sh (N, B, 3)."""
    degree = int(np.sqrt(arrays["sh"].shape[-2])) - 1
    with np.errstate(invalid="ignore"):  # a NaN that signals: Gaussians will name it
        return {
            **arrays,
            "means": arrays["means"] * HALF_TURN,
            "quats": arrays["quats"] * QUAT_SIGNS,
            "sh": arrays["sh"] * sh_signs(degree)[:, None],
        }
