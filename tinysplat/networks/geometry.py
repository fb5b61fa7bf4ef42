"""Pinhole geometry on tensors: rays, the plane-sweep warp, points, normals and rotations.

Everything is closed form and made of standard ONNX operators, so that networks built on it export as they are.
Conventions: docs/CONVENTIONS.md. Cameras are OpenCV (x right, y down, z forward); K is in pixels of the grid at hand
with the centre of the first pixel at (0.5, 0.5); c2w (V, 4, 4) is rigid, so its inverse is a transpose; depth is z.
A "grid" is the pixel lattice of a view at some resolution, images are (V, C, h, w).
"""

import torch
from torch import Tensor
from torch.nn import functional

BEHIND = 1e-4
"""Smallest z, as a multiple of the reference depth, at which a point still counts as before the source camera."""


def pixel_intrinsics(K_unit: Tensor, height: int, width: int) -> Tensor:
    """Intrinsics (…, 3, 3) in pixels of a height × width grid, from those divided by image width and height."""
    size = torch.tensor([[width], [height], [1]], dtype=K_unit.dtype, device=K_unit.device)
    return K_unit * size


def focal_length(K: Tensor) -> Tensor:
    """f = √(fx·fy), (V,)."""
    return torch.sqrt(K[:, 0, 0] * K[:, 1, 1])


def pixel_rays(K: Tensor, height: int, width: int) -> Tensor:
    """Rays through the pixel centres, (V, 3, height, width) in the camera frame with z = 1.

    K⁻¹ (j + 0.5, i + 0.5, 1)ᵀ by back substitution; skew is honoured.
    """
    column = torch.arange(width, dtype=K.dtype) + 0.5
    row = torch.arange(height, dtype=K.dtype) + 0.5
    entry = K[:, :, :, None, None]  # (V, 3, 3, 1, 1)
    y = (row[:, None] - entry[:, 1, 2]) / entry[:, 1, 1]  # (V, height, 1)
    x = (column[None, :] - entry[:, 0, 2] - entry[:, 0, 1] * y) / entry[:, 0, 0]  # (V, height, width)
    return torch.stack([x, y.expand_as(x), torch.ones_like(x)], dim=1)


def relative_pose(c2w_from: Tensor, c2w_to: Tensor) -> tuple[Tensor, Tensor]:
    """Rotation (N, 3, 3) and translation (N, 3) that take points of one camera frame to another's."""
    to_rotation = c2w_to[:, :3, :3].transpose(1, 2)
    shift = (c2w_from[:, :3, 3] - c2w_to[:, :3, 3])[:, :, None]
    return to_rotation @ c2w_from[:, :3, :3], (to_rotation @ shift)[:, :, 0]


def sweep_coefficients(rays: Tensor, K_source: Tensor, rotation: Tensor, translation: Tensor) -> tuple[Tensor, Tensor]:
    """The two terms of the plane sweep: a pixel at inverse depth ρ lies at homogeneous A + ρ·b in the source image.

    Args:
        rays: (N, 3, h, w) of the reference grid, z = 1.
        K_source: (N, 3, 3) intrinsics that the result is in.
        rotation: (N, 3, 3) reference to source.
        translation: (N, 3) reference to source.

    Returns:
        A (N, 3, h, w) and b (N, 3); the third component is source depth over reference depth.
    """
    turned = (K_source @ rotation) @ rays.flatten(2)
    return turned.view_as(rays), (K_source @ translation[:, :, None])[:, :, 0]


def project_sweep(turned: Tensor, shift: Tensor, inverse_depth: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Positions of reference pixels in the source image.

    Args:
        turned: (N, 3, h, w), A of `sweep_coefficients`.
        shift: (N, 3), b of `sweep_coefficients`.
        inverse_depth: (N, D, h, w) or (N, D, 1, 1), per candidate, ≥ 0.

    Returns:
        x, y (N, D, h, w) in the units of K_source, and the depth ratio z_source / z_reference (N, D, h, w), which is
        below `BEHIND` where the point lies behind the source camera (x and y are meaningless there).
    """
    x, y, ratio = (turned[:, i : i + 1] + shift[:, i, None, None, None] * inverse_depth for i in range(3))
    scale = 1 / ratio.clamp_min(BEHIND)
    return x * scale, y * scale, ratio


def sample_bilinear(images: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Read images (N, C, h, w) at positions x, y (N, D, a, b) in [0, 1] of width and height: (N, C, D, a, b).

    Outside the frame the nearest border value is returned.
    """
    n, d, a, b = x.shape
    grid = torch.stack([x, y], dim=-1).clamp(-1, 2) * 2 - 1
    read = functional.grid_sample(
        images, grid.view(n, d * a, b, 2), mode="bilinear", padding_mode="border", align_corners=False
    )
    return read.view(n, images.shape[1], d, a, b)


def inside_frame(x: Tensor, y: Tensor, ratio: Tensor) -> Tensor:
    """1 where a projected position (any shape, [0, 1] units) lies in the source frame before its camera, else 0."""
    inside = (x > 0) & (x < 1) & (y > 0) & (y < 1) & (ratio > BEHIND)
    return inside.to(x.dtype)


def unproject(rays: Tensor, depth: Tensor, c2w: Tensor) -> Tensor:
    """World points (V, 3, h, w) of camera rays (V, 3, h, w) with z = 1 at depth (V, 1, h, w)."""
    local = (rays * depth).flatten(2)
    world = c2w[:, :3, :3] @ local + c2w[:, :3, 3:]
    return world.view_as(rays)


def tilt_quats(slope_x: Tensor, slope_y: Tensor) -> Tensor:
    """Smallest rotation that turns the camera's z axis onto a surface normal, (…, 4) wxyz in the camera frame.

    The normal is (−slope_x, −slope_y, 1) before scaling. The half-angle form has no branch and no jump for any slope,
    and its third vector component is 0: q ∝ (1 + n_z, −n_y, n_x, 0) for the unit normal n.
    """
    inverse_norm = torch.rsqrt(1 + slope_x * slope_x + slope_y * slope_y)
    w = 1 + inverse_norm
    x, y = slope_y * inverse_norm, -slope_x * inverse_norm
    length = torch.rsqrt(w * w + x * x + y * y)
    return torch.stack([w * length, x * length, y * length, torch.zeros_like(w)], dim=-1)


def rotation_quats(rotation: Tensor) -> Tensor:
    """Unit quaternions (V, 4) wxyz of rotation matrices (V, 3, 3), stable for every angle.

    The row of largest norm of the symmetric 4×4 matrix 4·q qᵀ is a multiple of q (Shepperd 1978).
    """
    m = rotation
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    wx, wy, wz = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 1, 0] + m[:, 0, 1], m[:, 0, 2] + m[:, 2, 0], m[:, 2, 1] + m[:, 1, 2]
    diagonal = torch.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], dim=1)
    d0, d1, d2, d3 = diagonal.unbind(1)
    rows = [[d0, wx, wy, wz], [wx, d1, xy, xz], [wy, xy, d2, yz], [wz, xz, yz, d3]]
    outer = torch.stack([entry for row in rows for entry in row], dim=1).view(-1, 4, 4)
    best = diagonal.argmax(dim=1)  # (V,)
    row = torch.gather(outer, 1, best[:, None, None].expand(-1, 1, 4))[:, 0]
    return row * torch.rsqrt((row * row).sum(dim=1, keepdim=True))


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
