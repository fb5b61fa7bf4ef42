"""The axes of standards with y up, and back: SPZ, glTF and USD against .ply and OpenCV scenes, which have y down.

Half a turn about x: y and z change sign in positions, rotations and SH, so that viewers show both the same way up. It
is its own inverse. An extension of SPZ has sixteen further systems, and the nodes of a scene graph any pose.
"""

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.editing import rotate_sh
from ..gaussian.quaternions import matrices_to_quats, multiply_quats
from ..gaussian.sh import sh_basis

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


_UNIFORM = 1e-3  # relative difference of a node's scales along its axes that rounding explains


def placed(arrays: dict[str, NDArray], matrix: NDArray) -> dict[str, NDArray]:
    """Gaussians moved by a matrix.

    Args:
        arrays: means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), float.
        matrix: (4, 4) float64, a rotation, uniform scale and translation.

    Raises:
        InputError: the matrix stretches or mirrors, which no Gaussian can follow.
    """
    if np.array_equal(matrix, np.eye(4)):
        return arrays
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not np.isfinite(matrix).all() or lengths.min() <= 0:
        raise InputError("a node's matrix is no similarity")
    scale = float(lengths.mean())
    R = matrix[:3, :3] / scale
    if np.abs(R.T @ R - np.eye(3)).max() > _UNIFORM or np.linalg.det(R) < 0:
        raise InputError("a node stretches or mirrors its Gaussians, expected rotation, uniform scale and translation")
    with np.errstate(over="ignore", invalid="ignore"):  # Gaussians will name what is not finite
        means = arrays["means"] @ matrix[:3, :3].T + matrix[:3, 3]
        moved = {**arrays, "means": means, "scales": arrays["scales"] * scale}
        if not np.allclose(R, np.eye(3), atol=1e-12):
            left, _, right = np.linalg.svd(R)
            R = left @ right
            quats, sh = multiply_quats(matrices_to_quats(R), arrays["quats"]), rotate_sh(arrays["sh"], R)
            moved |= {"quats": quats, "sh": sh}
    return moved
