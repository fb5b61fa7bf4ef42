"""The codec's transforms as torch modules: VPT, VABR and their inverses (arXiv 2506.09479).

`export/transforms.py` writes them to the ONNX graphs that the runtime runs. They are matrix operations in float32;
what needs float64 (eigen-decomposition, camera inverses, folding of steps into matrices) is the caller's, on the host.

A layer's geometry is one tensor (V, 11, H, W) of channels in the order of
`tinysplat_runtime.gaussian.planes.GEOMETRY`; positions are depth along z in
scene units and the offset from the pixel's own centre in pixels, scales are ŝ = f·s/z in pixels, rotations are in the
camera frame.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn


def multiply_quats(a: Tensor, b: Tensor) -> Tensor:
    """Hamilton product of quaternions (…, 4), wxyz."""
    return torch.stack(turned(a.unbind(-1), b.unbind(-1)), dim=-1)


def turned(a: Sequence[Tensor], b: Sequence[Tensor]) -> list[Tensor]:
    """Components w, x, y, z, of one shape, of the Hamilton product of quaternions given by theirs."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]


def left_multiplication(quats: Tensor) -> Tensor:
    """Matrices L (…, 4, 4) with L(a) b = a ⊗ b for quaternions (…, 4), wxyz."""
    w, x, y, z = quats.unbind(-1)
    rows = [w, -x, -y, -z, x, w, -z, y, y, z, w, -x, z, -y, x, w]
    return torch.stack(rows, -1).unflatten(-1, (4, 4))


def unit_quats(quats: Tensor) -> Tensor:
    """Quaternions (…, 4) at unit length; a zero one stays zero."""
    return torch.stack(unit_components(quats.unbind(-1)), dim=-1)


def unit_components(quat: Sequence[Tensor]) -> list[Tensor]:
    """Components, of one shape, of quaternions at unit length; scaled by the largest first, for denormal ones."""
    tiny = torch.finfo(quat[0].dtype).tiny
    w, x, y, z = (component.abs() for component in quat)
    largest = torch.maximum(torch.maximum(w, x), torch.maximum(y, z)).clamp_min(tiny)
    w, x, y, z = (component / largest for component in quat)
    length = (w * w + x * x + y * y + z * z).sqrt().clamp_min(tiny)
    return [w / length, x / length, y / length, z / length]


def _columns(K: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """fx, fy, cx, cy, skew of K (V, 3, 3), each (V, 1, 1)."""
    entries = K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2], K[:, 0, 1]
    fx, fy, cx, cy, skew = (entry[:, None, None] for entry in entries)
    return fx, fy, cx, cy, skew


def _pixel_centres(height: int, width: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """u (1, W) and v (H, 1): pixel centres in pixels."""
    u = torch.arange(width, dtype=like.dtype, device=like.device)[None, :] + 0.5
    v = torch.arange(height, dtype=like.dtype, device=like.device)[:, None] + 0.5
    return u, v


class ViewProjection(nn.Module):
    """VPT: Gaussians of V views to planes (arXiv 2506.09479, view projection).

    The camera centre comes as a sum of two float32 numbers, so that means far from the origin lose nothing in the
    subtraction: mean − high is exact when the two are close (Sterbenz), and low corrects it.
    """

    def forward(
        self,
        means: Tensor,
        quats: Tensor,
        scales: Tensor,
        opacities: Tensor,
        K: Tensor,
        rotation: Tensor,
        rotation_quat: Tensor,
        centre_high: Tensor,
        centre_low: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Project.

        Args:
            means, quats, scales, opacities: (V, H, W, …), world frame relative to the origin.
            K: (V, 3, 3) pixels.
            rotation: (V, 3, 3) world to camera.
            rotation_quat: (V, 4) the same as a quaternion.
            centre_high, centre_low: (V, 3) camera centre relative to the origin.

        Returns:
            geometry (V, 11, H, W), and the second moment Σ q qᵀ / HW of the camera-frame quaternions (V, 4, 4).
        """
        height, width = means.shape[1], means.shape[2]
        fx, fy, cx, cy, skew = _columns(K)
        # Planar from the start: three or four numbers beside each other are what a processor is slowest at.
        points, turns, sizes = (interleaved.permute(0, 3, 1, 2) for interleaved in (means, quats, scales))
        relative = (points - centre_high[:, :, None, None]) - centre_low[:, :, None, None]
        x, y, z = (rotation @ relative.flatten(2)).unflatten(2, (height, width)).unbind(1)
        u, v = _pixel_centres(height, width, means)
        offset_x = (x / z) * fx + (y / z) * skew + (cx - u)
        offset_y = (y / z) * fy + (cy - v)
        projected = sizes * ((fx * fy).sqrt() / z)[:, None]
        q = torch.stack(turned(rotation_quat[:, :, None, None].unbind(1), unit_components(turns.unbind(1))), 1)
        flat = q.flatten(2)
        moment = flat @ flat.transpose(1, 2) / (height * width)
        channels = [z[:, None], offset_x[:, None], offset_y[:, None], projected, q, opacities[:, None]]
        return torch.cat(channels, 1), moment


class CoefficientMoment(nn.Module):
    """Uncentred second moment of all SH coefficient vectors (arXiv 2506.09479, basis reduction): XXᵀ/M, (3B, 3B)."""

    def forward(self, sh: Tensor) -> Tensor:
        """X Xᵀ / M (d, d) of sh (V, H, W, B, 3), X ∈ R^{d×M}; the caller weights it by Δ, a congruence."""
        x = sh.reshape(-1, sh.shape[3] * 3)
        return x.transpose(0, 1) @ x / x.shape[0]


class CoefficientProjection(nn.Module):
    """VABR forward: coefficients of every pixel to k planes (arXiv 2506.09479, basis reduction)."""

    def forward(self, sh: Tensor, projection: Tensor) -> Tensor:
        """Z = (WᵀΔ) X: sh (V, H, W, B, 3), projection (d, k) = (WᵀΔ)ᵀ; returns (V, k, H, W)."""
        x = sh.flatten(3)
        return (x @ projection).permute(0, 3, 1, 2).contiguous()


class Synthesis(nn.Module):
    """Integer planes of one layer to Gaussians: dequantisation, VABR⁻¹ (X̂ = Δ⁻¹WZ), VPT⁻¹ (arXiv 2506.09479).

    Dequantisation and every linear map behind it arrive folded into one matrix per plane group, value = mix · codes,
    with a last plane of ones for the offsets: one graph serves all profiles, and memory is passed over once.
    """

    def forward(
        self,
        geometry_codes: Tensor,
        geometry_mix: Tensor,
        color_codes: Tensor,
        color_mix: Tensor,
        K: Tensor,
        rotation: Tensor,
        rotation_quat: Tensor,
        centre: Tensor,
        inverse_depth: Tensor,
        relative_rotation: Tensor,
        depth_limits: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Reconstruct.

        Args:
            geometry_codes: (V, P + 1, H, W) uint16, the last plane all ones.
            geometry_mix: (V, 11, P + 1), codes to channels.
            color_codes: (V, k + 1, H, W) uint16, the last plane all ones.
            color_mix: (k + 1, d), codes to coefficients.
            K: (V, 3, 3) pixels.
            rotation: (V, 3, 3) camera to world.
            rotation_quat: (V, 4) camera to world, times the reference rotation if rotations are relative.
            centre: (V, 3) camera centre relative to the origin.
            inverse_depth: (), above 0 when the depth channel holds −1/z.
            relative_rotation: (), above 0 when the rotation's w is to be rebuilt from its vector part.
            depth_limits: (2,) smallest and largest z that were coded; quantisation noise may not leave them.

        Returns:
            means (V, H, W, 3), quats (V, H, W, 4), scales (V, H, W, 3), opacities (V, H, W), and sh (V, H, W, d), whose
            split into functions and colours is the caller's: a reshape inside the graph would copy it.
        """
        views, _, height, width = geometry_codes.shape
        fx, fy, cx, cy, skew = _columns(K)
        values = geometry_mix @ geometry_codes.to(torch.float32).flatten(2)
        values = values.reshape(views, 11, height, width)

        depth = values[:, 0]
        # An inverse depth may have been pushed through 0 by noise; clamping it to the limits' own inverses undoes that.
        inverse = torch.minimum(torch.maximum(depth, -1 / depth_limits[0]), -1 / depth_limits[1])
        z = torch.where(inverse_depth > 0, -1 / inverse, depth)
        z = torch.minimum(torch.maximum(z, depth_limits[0]), depth_limits[1])
        u, v = _pixel_centres(height, width, values)
        y = (values[:, 2] + (v - cy)) / fy
        x = (values[:, 1] + (u - cx) - skew * y) / fx
        # Planar until the end: a product with (V, 3, HW) and one transpose take a third of the time of einsum's way.
        camera = torch.stack([x * z, y * z, z], 1)
        points = rotation @ camera.flatten(2) + centre[..., None]

        scales = values[:, 3:6].clamp_min(0) * (z / (fx * fy).sqrt())[:, None]
        # Plane by plane: onnxruntime's sum over the planes alone took 7 % of the graph's time, for the same bits.
        i, j, k = values[:, 7], values[:, 8], values[:, 9]
        squared = i * i + j * j + k * k
        rebuilt = (1 - squared).clamp_min(MIN_W**2).sqrt()
        w = torch.where(relative_rotation > 0, rebuilt, values[:, 6])
        squared = squared + w * w
        is_zero = (squared == 0).to(torch.float32)  # noise may have hit zero: the identity then
        q = torch.stack([w + is_zero, i, j, k], 1) / (squared + is_zero).sqrt()[:, None]
        quats = left_multiplication(rotation_quat) @ q.flatten(2)

        sh = color_codes.permute(0, 2, 3, 1).to(torch.float32) @ color_mix
        means, quats = (planes.unflatten(2, (height, width)).permute(0, 2, 3, 1) for planes in (points, quats))
        return means, quats, scales.permute(0, 2, 3, 1), values[:, 10].clamp(0, 1), sh


MIN_W = 0.1
"""Least w of a relative rotation rebuilt from a vector part that noise made longer than 1."""
