"""3-D Gaussians to 2-D splats as differentiable torch operations: EWA projection.

The definition is that of `tinysplat_runtime.render.project` (Zwicker et al. 2001; Kerbl et al. 2023): in pixels²,
Σ₂ = J W Σ Wᵀ Jᵀ + 0.3·1, J taken at the mean clamped to the image widened by 15 % of its size on each side.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tinysplat_runtime.render.project import DILATION, JACOBIAN_MARGIN
from tinysplat_runtime.render.renderer import NEAR_PLANE


@dataclass(frozen=True)
class PinholeCamera:
    """Where a picture is taken.

    Attributes:
        K: (3, 3) intrinsics in pixels.
        c2w: (4, 4) rigid, OpenCV axes.
        height, width: of the picture, pixels.
    """

    K: Tensor
    c2w: Tensor
    height: int
    width: int


@dataclass(frozen=True)
class ProjectedSplats:
    """Gaussians as the picture sees them; every tensor but `depth` carries gradients.

    Attributes:
        centres: (N, 2) pixels, x and y.
        factors: (N, 3) αx, βx, γ of the exponent −(αx·dx + βx·dy)² − (γ·dy)², as in the runtime.
        depths: (N,) z in the camera frame.
    """

    centres: Tensor
    factors: Tensor
    depths: Tensor


def quats_to_rotations(quats: Tensor) -> tuple[Tensor, ...]:
    """The nine entries (N,), row by row, of the rotation matrices of unit quaternions (N, 4) wxyz."""
    w, x, y, z = quats.unbind(-1)
    return (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )


def project(means: Tensor, quats: Tensor, scales: Tensor, camera: PinholeCamera) -> ProjectedSplats:
    """Project Gaussians.

    Args:
        means: (N, 3) world.
        quats: (N, 4) wxyz, unit.
        scales: (N, 3) standard deviations, scene units.
        camera: where the picture is taken.

    Returns:
        Splats; those with depth under `NEAR_PLANE` hold finite numbers without meaning.
    """
    rotation = camera.c2w[:3, :3]
    local = (means - camera.c2w[:3, 3]) @ rotation
    depth = local[:, 2]
    inverse_depth = 1 / depth.clamp_min(NEAR_PLANE)
    intrinsics = camera.K.clone()
    intrinsics[:2, 2] = 0
    projection = intrinsics @ rotation.T
    centred = (local @ intrinsics[:2].T) * inverse_depth[:, None]
    size = means.new_tensor([camera.width, camera.height])
    principal = camera.K[:2, 2]
    low, high = -JACOBIAN_MARGIN * size - principal, (1 + JACOBIAN_MARGIN) * size - principal
    clamped = torch.minimum(torch.maximum(centred, low), high)
    jacobian = (projection[:2] - clamped[:, :, None] * projection[2]) * inverse_depth[:, None, None]  # (N, 2, 3)
    axes = torch.stack(quats_to_rotations(quats), dim=-1).view(-1, 3, 3) * scales[:, None, :]
    m = jacobian @ axes
    a = m[:, 0].square().sum(dim=-1) + DILATION
    b = (m[:, 0] * m[:, 1]).sum(dim=-1)
    c = m[:, 1].square().sum(dim=-1) + DILATION
    det = torch.linalg.cross(m[:, 0], m[:, 1]).square().sum(dim=-1) + DILATION * (a + c) - DILATION**2
    alpha_x = (0.5 * c / det).sqrt()
    factors = torch.stack([alpha_x, -alpha_x * b / c, (0.5 / c).sqrt()], dim=-1)
    return ProjectedSplats(centred + principal, factors, depth.detach())
