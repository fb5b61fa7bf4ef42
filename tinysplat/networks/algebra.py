"""Batched closed-form camera algebra of the official networks, in torch.

Inverses are written out because ONNX has no matrix inverse: the formulas that run here are those of the exported
graphs. Leading axes are free here; `geometry.py` has what works on one list of views. Quaternions are wxyz.
"""

import torch
from torch import Tensor


def invert_intrinsics(K: Tensor) -> Tensor:
    """Invert intrinsics (…, 3, 3) of the form [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]."""
    fx, skew, cx = K[..., 0, 0], K[..., 0, 1], K[..., 0, 2]
    fy, cy = K[..., 1, 1], K[..., 1, 2]
    zero, one = torch.zeros_like(fx), torch.ones_like(fx)
    rows = [[1 / fx, -skew / (fx * fy), (skew * cy / fy - cx) / fx], [zero, 1 / fy, -cy / fy], [zero, zero, one]]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def quats_to_matrices(quats: Tensor) -> Tensor:
    """Rotation matrices (…, 3, 3) of unit quaternions (…, 4)."""
    w, x, y, z = quats.unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
