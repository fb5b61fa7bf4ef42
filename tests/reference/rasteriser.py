"""The rasteriser's definition, slow and obvious: float64, one Gaussian after the other, all pixels each time.

Independent of the runtime's arithmetic: explicit covariances and inverses, spherical harmonics from the Legendre
polynomials, no tiles, no footprints.
"""

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
    return np.array([[K[0, 0] / z, K[0, 1] / z, -(K[0, 0] * x + K[0, 1] * y) / z], [0, K[1, 1] / z, -K[1, 1] * y / z]])


def own_pixels(gaussians: Gaussians) -> NDArray:
    """(N,) z / f of each Gaussian in the photo that it stands for, scene units; 0 where it stands for none."""
    sizes = []
    for layer in gaussians.layers:
        size = np.zeros(layer.opacities.shape)
        for view, photo in enumerate(gaussians.cameras):
            points = layer.means[view].astype(np.float64) + gaussians.origin
            z = (points @ photo.w2c[:3, :3].T + photo.w2c[:3, 3])[..., 2]
            size[view] = np.maximum(z, 0) / math.sqrt(photo.K[0, 0] * photo.K[1, 1])
        sizes.append(size.ravel())
    return np.concatenate(sizes)


def shares(gaussians: Gaussians, camera: Camera) -> tuple[NDArray, NDArray]:
    """(N,) each: the share of its alphas that each Gaussian is drawn first with, and of its opacity that it has."""
    photos = gaussians.cameras
    front, opaque = np.zeros(max(len(photos), 1)), np.ones(max(len(photos), 1))
    if len(photos) > 1:
        z = [
            (gaussians.means[v].astype(np.float64) + gaussians.origin - photo.c2w[:3, 3]) @ photo.c2w[:3, 2]
            for v, photo in enumerate(photos)
        ]
        depth = 1 / np.mean(1 / np.concatenate([part[part > 0] for part in z]))
        apart = [(camera.c2w - photo.c2w)[:3] for photo in photos]
        distance = np.array([math.hypot(*(one[:, 3] / depth), *one[:, 2]) for one in apart])
        ranked = np.sort(distance)
        front = np.clip((1.5 * ranked[1] - distance) / (1.5 * ranked[1] - ranked[0]), 0, 1) ** 2
        if len(photos) > 6:
            opaque = np.clip((ranked[6] - distance) / (ranked[6] - ranked[1]), 0, 1)
    sizes = [(n, layer.opacities[0].size) for n, layer in enumerate(gaussians.layers)]
    fronts = np.concatenate([np.repeat(front * (n == 0), size) for n, size in sizes])
    return fronts, np.concatenate([np.repeat(opaque, size) for _, size in sizes])


def render_reference(
    gaussians: Gaussians,
    camera: Camera,
    background: tuple[float, ...] = (0, 0, 0),
    near_plane: float = 0.01,
    dilation: str = "screen",
    order: str = "depth",
) -> dict[str, NDArray]:
    """Pictures "rgb" (H, W, 3), not clipped, "depth" (H, W) and "alpha" (H, W), float64."""
    flat = gaussians.flat()
    own = own_pixels(gaussians) if dilation == "own" else np.zeros(flat.opacities.size)
    front, opaque = np.zeros(flat.opacities.size), np.ones(flat.opacities.size)
    if order == "near" and gaussians.cameras:
        front, opaque = shares(gaussians, camera)
    means = flat.means.astype(np.float64) + (flat.origin - camera.centre)
    points = means @ camera.rotation.T
    basis = sh_basis(means / np.linalg.norm(means, axis=-1, keepdims=True), flat.degree)
    colours = np.maximum(0.5 + np.einsum("nb,nbc->nc", basis, flat.sh.astype(np.float64)), 0)

    pixels = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
    pictures = before, behind_it = Picture(pixels.shape[:2]), Picture(pixels.shape[:2])
    for i in np.argsort(points[:, 2], kind="stable"):
        z = points[i, 2]
        if z <= near_plane:
            continue
        to_pixels = jacobian(camera, points[i]) @ camera.rotation
        axes = to_pixels @ rotation_matrix(flat.quats[i].astype(np.float64)) * flat.scales[i].astype(np.float64)
        opacity = float(flat.opacities[i] * opaque[i])
        footprint = axes @ axes.T + 0.3 * np.eye(2)
        if own[i] > 0:
            pixel = max(own[i] * math.sqrt(camera.K[0, 0] * camera.K[1, 1]) / z, 1 / 8)  # its width on the screen
            if pixel > 1:
                lacks = 0.3 * pixel**2 - np.linalg.eigvalsh(axes @ axes.T)[0]
                footprint = axes @ axes.T + max(lacks, 0.3) * np.eye(2)
            else:
                in_photo = axes @ axes.T + 0.3 * pixel**2 * np.eye(2)
                opacity *= math.sqrt(np.linalg.det(in_photo) / np.linalg.det(footprint))
        inverse = np.linalg.inv(footprint)
        d = pixels - (camera.K @ points[i])[:2] / z
        alpha = np.minimum(0.99, opacity * np.exp(-0.5 * np.einsum("hwi,ij,hwj->hw", d, inverse, d)))
        alpha[alpha < 1 / 255] = 0
        for picture, part in zip(pictures, (front[i], 1), strict=True):
            picture.blend(part * alpha, colours[i], z)
    rgb, depth = (getattr(before, name) + (before.left.T * getattr(behind_it, name).T).T for name in ("rgb", "depth"))
    left = before.left * behind_it.left
    alpha = 1 - left
    depth = np.divide(depth, alpha, out=np.zeros_like(depth), where=alpha > 0)
    return {"rgb": rgb + left[..., None] * np.asarray(background, np.float64), "depth": depth, "alpha": alpha}


class Picture:
    """What pixels have gathered."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.left, self.stopped = np.ones(shape), np.zeros(shape, bool)
        self.rgb, self.depth = np.zeros((*shape, 3)), np.zeros(shape)

    def blend(self, alpha: NDArray, colour: NDArray, z: float) -> None:
        """Blend the next splat."""
        self.stopped |= self.left * (1 - alpha) < 1e-4
        weight = np.where(self.stopped, 0, alpha * self.left)
        self.rgb += weight[..., None] * colour
        self.depth += weight * z
        self.left -= weight
