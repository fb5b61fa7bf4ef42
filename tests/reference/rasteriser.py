"""The rasteriser's definition, slow and obvious: float64, one Gaussian after the other, all pixels each time.

Independent of the runtime's arithmetic: explicit covariances and inverses, spherical harmonics from the Legendre
polynomials, no tiles, no footprints.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import NDArray

from tinysplat_runtime import Camera, Gaussians


def sh_basis(directions: NDArray, degree: int) -> NDArray:
    """(…, (degree + 1)²) real spherical harmonics with the Condon-Shortley phase: 3DGS's order and signs."""
    x, y, z = np.moveaxis(directions, -1, 0)
    azimuth = np.arctan2(y, x)
    functions = []
    for l in range(degree + 1):  # noqa: E741 - degree and order are l and m
        for m in range(-l, l + 1):
            k = abs(m)
            associated = (-1) ** k * np.sqrt(np.maximum(1 - z * z, 0)) ** k * Legendre.basis(l).deriv(k)(z)
            norm = math.sqrt((2 * l + 1) / (4 * math.pi) * math.factorial(l - k) / math.factorial(l + k))
            turn = math.sqrt(2) * (np.sin(k * azimuth) if m < 0 else np.cos(k * azimuth)) if m else 1.0
            functions.append(norm * associated * turn)
    return np.stack(functions, axis=-1)


def rotation_matrix(quat: NDArray) -> NDArray:
    """(3, 3) of a quaternion wxyz of any length: v ↦ q v q⁻¹ for each axis."""
    w, u = quat[0], quat[1:]
    cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    return ((w * w - u @ u) * np.eye(3) + 2 * np.outer(u, u) + 2 * w * cross) / (quat @ quat)


def jacobian(camera: Camera, point: NDArray) -> NDArray:
    """(2, 3) derivative of the pixel by the point in the camera frame, at the point clamped to the widened image."""
    K, size = camera.K, np.array([camera.width, camera.height])
    pixel = np.clip((K @ point)[:2] / point[2], -0.15 * size, 1.15 * size)
    x, y, _ = np.linalg.solve(K, [*pixel, 1])
    z = point[2]
    return np.array(
        [
            [K[0, 0] / z, K[0, 1] / z, -(K[0, 0] * x + K[0, 1] * y) / z],
            [0, K[1, 1] / z, -K[1, 1] * y / z],
        ]
    )


def render_reference(
    gaussians: Gaussians, camera: Camera, background: tuple[float, ...] = (0, 0, 0), near_plane: float = 0.01
) -> dict[str, NDArray]:
    """Pictures "rgb" (H, W, 3), not clipped, "depth" (H, W) and "alpha" (H, W), float64."""
    flat = gaussians.flat()
    means = flat.means.astype(np.float64) + (flat.origin - camera.centre)
    points = means @ camera.rotation.T
    basis = sh_basis(means / np.linalg.norm(means, axis=-1, keepdims=True), flat.degree)
    colours = np.maximum(0.5 + np.einsum("nb,nbc->nc", basis, flat.sh.astype(np.float64)), 0)

    pixels = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
    left, stopped = np.ones(pixels.shape[:2]), np.zeros(pixels.shape[:2], bool)
    rgb, depth = np.zeros((*left.shape, 3)), np.zeros_like(left)
    for i in np.argsort(points[:, 2], kind="stable"):
        z = points[i, 2]
        if z <= near_plane:
            continue
        to_pixels = jacobian(camera, points[i]) @ camera.rotation
        axes = to_pixels @ rotation_matrix(flat.quats[i].astype(np.float64)) * flat.scales[i].astype(np.float64)
        inverse = np.linalg.inv(axes @ axes.T + 0.3 * np.eye(2))
        d = pixels - (camera.K @ points[i])[:2] / z
        alpha = np.minimum(0.99, flat.opacities[i] * np.exp(-0.5 * np.einsum("hwi,ij,hwj->hw", d, inverse, d)))
        alpha = np.where((alpha < 1 / 255) | stopped, 0, alpha)
        stopped |= left * (1 - alpha) < 1e-4
        weight = np.where(stopped, 0, alpha * left)
        rgb += weight[..., None] * colours[i]
        depth += weight * z
        left -= weight
    alpha = 1 - left
    depth = np.divide(depth, alpha, out=np.zeros_like(depth), where=alpha > 0)
    return {"rgb": rgb + left[..., None] * np.asarray(background, np.float64), "depth": depth, "alpha": alpha}
