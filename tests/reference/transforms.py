"""VPT, VABR and their inverses in float64, from the paper's formulas (arXiv 2506.09479): slow, obvious."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, multiply_quats, normalize_quats
from tinysplat_runtime.scene.cameras import Camera


def pixel_centres(height: int, width: int) -> NDArray:
    """(H, W, 2) float64 u, v of pixel centres."""
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)


def project_view(gaussians: Gaussians, view: int) -> NDArray:
    """(11, H, W) float64: depth, offset x y, ŝ, quaternion in the camera frame, opacity.

    arXiv 2506.09479, view projection: z·(x, y, 1)ᵀ = K(Rμ + T), q̂ = Quat(R)·q, ŝ = f·s/z.
    """
    camera = gaussians.cameras[view]
    R, c = camera.rotation, camera.centre
    means = gaussians.means[view].astype(np.float64) + gaussians.origin
    p = (means - c) @ R.T
    z = p[..., 2]
    uv = (p @ camera.K.T)[..., :2] / z[..., None] - pixel_centres(*z.shape)
    scales = gaussians.scales[view].astype(np.float64) * camera.focal / z[..., None]
    quats = multiply_quats(matrices_to_quats(R), normalize_quats(gaussians.quats[view].astype(np.float64)))
    return np.concatenate(
        [z[None], *(np.moveaxis(a, -1, 0) for a in (uv, scales, quats)), gaussians.opacities[view][None]]
    )


def unproject_view(geometry: NDArray, camera: Camera, origin: NDArray) -> dict[str, NDArray]:
    """The inverse of `project_view` (11, H, W), float64: means (H, W, 3) relative to the origin, and the others.

    arXiv 2506.09479, view projection: μ = Rᵀ(K⁻¹·z·(x, y, 1)ᵀ − T), q = Quat(R)⁻¹·q̂, s = ŝ·z/f.
    """
    z = geometry[0]
    uv = pixel_centres(*z.shape) + np.moveaxis(geometry[1:3], 0, -1)
    rays = np.concatenate([uv, np.ones((*z.shape, 1))], axis=-1) @ np.linalg.inv(camera.K).T
    R = camera.rotation
    return {
        "means": (rays * z[..., None]) @ R + camera.centre - origin,
        "quats": multiply_quats(matrices_to_quats(R.T), normalize_quats(np.moveaxis(geometry[6:10], 0, -1))),
        "scales": np.moveaxis(geometry[3:6], 0, -1) * z[..., None] / camera.focal,
        "opacities": geometry[10],
    }


def coefficient_moment(sh: NDArray) -> NDArray:
    """X Xᵀ / M (d, d) float64 of SH coefficients (…, B, 3): the uncentred second moment that VABR decomposes.

    arXiv 2506.09479, basis reduction.
    """
    x = sh.reshape(-1, sh.shape[-2] * 3).astype(np.float64)
    return x.T @ x / len(x)


def project_coefficients(sh: NDArray, projection: NDArray) -> NDArray:
    """Z (V, k, H, W) float64 of SH coefficients (V, H, W, B, 3) under `projection` (d, k): Z = WᵀΔX.

    arXiv 2506.09479, basis reduction.
    """
    x = sh.reshape(*sh.shape[:3], -1).astype(np.float64)
    return np.moveaxis(x @ projection.astype(np.float64), -1, 1)


def synthesise(inputs: Mapping[str, NDArray], cameras: Sequence[Camera], origin: NDArray) -> dict[str, NDArray]:
    """Codes back to Gaussians: what the graph `synthesis` computes from its inputs (docs/FORMAT.md), in float64.

    arXiv 2506.09479: dequantisation, VABR⁻¹ (X̂ = Δ⁻¹WZ) and VPT⁻¹.

    Args:
        inputs: the graph's, by name; steps and matrices are taken as they are.
        cameras: the layer's views, in float64, in place of the graph's rounded ones.
        origin: (3,) that means are relative to.

    Returns:
        means, quats, scales, opacities and sh (V, H, W, d), float64.
    """
    codes, colors = (inputs[name].astype(np.float64) for name in ("geometry_codes", "color_codes"))
    geometry = np.einsum("vcp,vphw->vchw", inputs["geometry_mix"].astype(np.float64), codes)
    low, high = inputs["depth_limits"].astype(np.float64)
    if inputs["inverse_depth"] > 0:  # one that noise pushed through 0 means far away
        geometry[:, 0] = -1 / geometry[:, 0].clip(-1 / low, -1 / high)
    geometry[:, 0] = geometry[:, 0].clip(low, high)
    geometry[:, 3:6] = geometry[:, 3:6].clip(0)
    geometry[:, 10] = geometry[:, 10].clip(0, 1)
    if inputs["relative_rotation"] > 0:
        geometry[:, 6] = np.sqrt((1 - (geometry[:, 7:10] ** 2).sum(axis=1)).clip(1e-2))
    views = [unproject_view(planes, camera, origin) for planes, camera in zip(geometry, cameras, strict=True)]
    out = {name: np.stack([view[name] for view in views]) for name in views[0]}
    turn = inputs["rotation_quat"].astype(np.float64)[:, None, None]
    out["quats"] = multiply_quats(turn, normalize_quats(np.moveaxis(geometry[:, 6:10], 1, -1)))
    out["sh"] = np.einsum("vkhw,kd->vhwd", colors, inputs["color_mix"].astype(np.float64))
    return out
