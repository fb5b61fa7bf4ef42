"""From a network's raw channels and depth to Gaussians in the world: the last, parameter-free step of both networks."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from tinysplat.transforms import multiply_quats

from .geometry import invert_intrinsics, quats_to_matrices, rotation_quats

MIN_SCALE, MAX_SCALE = 0.5, 15.0
"""Range of the relative scale rule, in tenths of a pixel's footprint (fx and fy summed)."""

SOFTPLUS_SHIFT, SOFTPLUS_FLOOR, SOFTPLUS_CEILING = 4.0, 1e-10, 3.0
"""The absolute scale rule: clamp(softplus(s − shift), floor, ceiling), scene units."""

QUAT_EPSILON = 1e-8


def offset_rays(K: Tensor, offsets: Tensor) -> Tensor:
    """Camera rays with z = 1 through pixel centres moved by sigmoid(offset) − 0.5 pixels.

    Args:
        K: (B, V, 3, 3) normalised by image size.
        offsets: (B, V, 2, H, W) raw x and y.

    Returns:
        (B, V, H, W, 3).
    """
    height, width = offsets.shape[-2:]
    moved = offsets.sigmoid()  # the pixel's left edge plus this is its centre plus sigmoid − 0.5
    x = (moved[:, :, 0] + torch.arange(width, dtype=K.dtype, device=K.device)) / width
    y = (moved[:, :, 1] + torch.arange(height, dtype=K.dtype, device=K.device)[:, None]) / height
    entry = invert_intrinsics(K)[..., None, None]  # (B, V, 3, 3, 1, 1)
    ray_x = entry[:, :, 0, 0] * x + entry[:, :, 0, 1] * y + entry[:, :, 0, 2]
    ray_y = entry[:, :, 1, 1] * y + entry[:, :, 1, 2]
    return torch.stack([ray_x, ray_y, torch.ones_like(ray_x)], dim=-1)


def place_means(rays: Tensor, depth: Tensor, c2w: Tensor) -> Tensor:
    """World points (B, V, H, W, 3) at z-depth (B, V, H, W) along rays with z = 1."""
    local = (rays * depth[..., None]).flatten(2, 3)
    world = local @ c2w[..., :3, :3].transpose(-1, -2) + c2w[:, :, None, :3, 3]
    return world.view_as(rays)


def world_quats(raw: Tensor, c2w: Tensor) -> Tensor:
    """Raw camera-frame quaternions xyzw (B, V, 4, H, W) to unit wxyz in the world (B, V, H, W, 4)."""
    raw = raw.permute(0, 1, 3, 4, 2)
    unit = raw / (raw.norm(dim=-1, keepdim=True) + QUAT_EPSILON)
    wxyz = torch.cat([unit[..., 3:], unit[..., :3]], dim=-1)
    cameras = rotation_quats(c2w[..., :3, :3].flatten(0, 1)).unflatten(0, c2w.shape[:2])
    return multiply_quats(cameras[:, :, None, None], wxyz)


def relative_scales(raw: Tensor, depth: Tensor, K: Tensor) -> Tensor:
    """Scales as multiples of the pixel's footprint at the predicted depth (MVSplat; DepthSplat of March 2025).

    (0.5 + 14.5 sigmoid(s)) · depth · m with m = 0.1 Σ K⁻¹[:2, :2] (1/W, 1/H).

    Args:
        raw: (B, V, 3, H, W).
        depth: (B, V, H, W) the value that the network predicts: ray length for MVSplat, z for DepthSplat.
        K: (B, V, 3, 3) normalised by image size.

    Returns:
        (B, V, H, W, 3) scene units.
    """
    height, width = depth.shape[-2:]
    inverse = invert_intrinsics(K)
    footprint = 0.1 * (inverse[..., 0, 0] / width + (inverse[..., 0, 1] + inverse[..., 1, 1]) / height)
    factor = MIN_SCALE + (MAX_SCALE - MIN_SCALE) * raw.sigmoid().permute(0, 1, 3, 4, 2)
    return factor * (depth * footprint[..., None, None])[..., None]


def absolute_scales(raw: Tensor) -> Tensor:
    """Scales in scene units, whatever the depth (DepthSplat of April 2025): (B, V, 3, H, W) to (B, V, H, W, 3)."""
    positive = functional.softplus(raw - SOFTPLUS_SHIFT)
    return positive.clamp(SOFTPLUS_FLOOR, SOFTPLUS_CEILING).permute(0, 1, 3, 4, 2)


@dataclass(frozen=True)
class PixelGaussians:
    """Gaussians of B scenes with V views of H × W pixels; float32, world frame, scene units.

    Attributes:
        means: (B, V, H, W, 3) centres.
        quats: (B, V, H, W, 4) unit rotations, wxyz.
        scales: (B, V, H, W, 3) standard deviations along the local axes.
        opacities: (B, V, H, W) in [0, 1].
        sh: (B, V, H, W, S, 3) coefficients of the standard 3DGS basis.
        depth: (B, V, H, W) z in the camera frame of the own view.
    """

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    sh: Tensor
    depth: Tensor

    def covariances(self) -> Tensor:
        """Σ = R diag(s)² Rᵀ, (B, V, H, W, 3, 3), scene units squared (Kerbl et al. 2023, eq. 6)."""
        half = quats_to_matrices(self.quats) * self.scales[..., None, :]
        return half @ half.transpose(-1, -2)
