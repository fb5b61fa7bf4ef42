"""Gaussians put where a node of a scene graph wants them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.editing import rotate_sh
from ..gaussian.quaternions import matrices_to_quats, multiply_quats

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
