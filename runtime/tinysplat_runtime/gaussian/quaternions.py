"""Quaternion algebra. Quaternions are wxyz on the last axis; q and -q are the same rotation."""

import numpy as np
from numpy.typing import NDArray


def normalize_quats(quats: NDArray, axis: int = -1) -> NDArray:
    """Scale quaternions (…, 4) of any float dtype to unit length, denormal and huge ones too; zero stays zero.

    `axis` is where the four components lie, if not last.
    """
    largest = np.abs(quats).max(axis=axis, keepdims=True)
    scaled = np.divide(quats, largest, out=np.zeros_like(quats), where=largest > 0)
    norm = np.linalg.norm(scaled, axis=axis, keepdims=True)
    return np.divide(scaled, norm, out=np.zeros_like(scaled), where=norm > 0)


_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])  # components beside the largest


def smallest_three(quats: NDArray) -> tuple[NDArray, NDArray]:
    """What file formats keep of unit quaternions (N, 4): the index of the largest component (N,) int64, and the other
    three (N, 3) in order, at most √½ in magnitude, of the sign that makes the largest positive."""
    largest = np.abs(quats).argmax(axis=1)
    signs = np.where(np.take_along_axis(quats, largest[:, None], axis=1) < 0, -1, 1)
    return largest, np.take_along_axis(quats, _OTHERS[largest], axis=1) * signs


def from_smallest_three(largest: NDArray, three: NDArray) -> NDArray:
    """Unit quaternions (N, 4) float64 of the parts of `smallest_three`; three longer than 1 leave the largest none."""
    quats = np.zeros((len(three), 4))
    np.put_along_axis(quats, _OTHERS[largest], three, axis=1)
    rest = np.sqrt(np.maximum(1 - (three**2).sum(axis=1), 0))
    np.put_along_axis(quats, largest[:, None], rest[:, None], axis=1)
    return quats


def multiply_quats(a: NDArray, b: NDArray) -> NDArray:
    """Hamilton product a ⊗ b of quaternions (…, 4) of any float dtype: the rotation b, then the rotation a."""
    aw, ax, ay, az = (a[..., i] for i in range(4))
    bw, bx, by, bz = (b[..., i] for i in range(4))
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate_quats(quats: NDArray) -> NDArray:
    """The inverse rotations of unit quaternions (…, 4), in their float dtype."""
    return quats * np.array([1, -1, -1, -1], quats.dtype)


def rotation_entries(w: NDArray, x: NDArray, y: NDArray, z: NDArray) -> list[list[NDArray]]:
    """Rows of entries of the rotation matrices of unit quaternions, given by float components of one shape."""
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def quats_to_matrices(quats: NDArray) -> NDArray:
    """Rotation matrices (…, 3, 3) of unit quaternions (…, 4), in their float dtype."""
    rows = rotation_entries(*(quats[..., i] for i in range(4)))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def matrices_to_quats(matrices: NDArray) -> NDArray:
    """Unit quaternions (…, 4) of rotation matrices (…, 3, 3) of a float dtype, the largest component positive.

    Each of the four quaternions 4·q_i·q comes from sums of matrix entries; the one with the largest q_i² is taken,
    so that the square root's argument never falls below 1 and rotations near π are as exact as any (Shepperd 1978).
    Quat(R) of arXiv 2506.09479, view projection.
    """
    m = np.asarray(matrices)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    candidates = np.stack(
        [
            np.stack([1 + xx + yy + zz, wx, wy, wz], axis=-1),
            np.stack([wx, 1 + xx - yy - zz, xy, xz], axis=-1),
            np.stack([wy, xy, 1 - xx + yy - zz, yz], axis=-1),
            np.stack([wz, xz, yz, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )  # (…, 4 candidates, 4)
    best = np.argmax(np.diagonal(candidates, axis1=-2, axis2=-1), axis=-1)
    chosen = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    return normalize_quats(chosen)


def left_multiplication_matrices(quats: NDArray) -> NDArray:
    """Matrices L(q) (…, 4, 4) with L(q) p = q ⊗ p, in the float dtype of `quats` (…, 4)."""
    w, x, y, z = (quats[..., i] for i in range(4))
    rows = [[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
