"""VPT and its inverse in float64, from the paper's formulas (arXiv 2506.09479), a view at a time: slow, obvious."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.cameras import Camera
from tinysplat_runtime.gaussians import Gaussians
from tinysplat_runtime.quaternions import matrices_to_quats, multiply_quats, normalize_quats


def pixel_centres(height: int, width: int) -> NDArray:
    """(H, W, 2) u, v of pixel centres."""
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)


def project_view(gaussians: Gaussians, view: int, origin: NDArray | None = None) -> NDArray:
    """(11, H, W) float64: depth, offset x y, ŝ, quaternion in the camera frame, opacity."""
    camera = gaussians.cameras[view]
    R, c = camera.rotation, camera.centre
    means = gaussians.means[view].astype(np.float64) + (gaussians.origin if origin is None else origin)
    p = (means - c) @ R.T
    z = p[..., 2]
    uv = (p @ camera.K.T)[..., :2] / z[..., None] - pixel_centres(*z.shape)
    scales = gaussians.scales[view].astype(np.float64) * camera.focal / z[..., None]
    quats = multiply_quats(matrices_to_quats(R), normalize_quats(gaussians.quats[view].astype(np.float64)))
    return np.concatenate(
        [z[None], *(np.moveaxis(a, -1, 0) for a in (uv, scales, quats)), gaussians.opacities[view][None]]
    )


def unproject_view(geometry: NDArray, camera: Camera, origin: NDArray) -> dict[str, NDArray]:
    """The inverse of `project_view`, float64: means relative to the origin, quats, scales, opacities."""
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
