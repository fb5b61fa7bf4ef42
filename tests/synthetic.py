"""Made-up cameras and Gaussians for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.cameras import Camera
from tinysplat_runtime.gaussians import Gaussians
from tinysplat_runtime.quaternions import normalize_quats, quats_to_matrices


def make_cameras(
    views: int, height: int, width: int, *, seed: int = 0, centre: NDArray | None = None, turn: float = 0.2
) -> list[Camera]:
    """Cameras around `centre`, looking roughly along z, with skew and an off-centre principal point."""
    rng = np.random.default_rng(seed)
    cameras = []
    for _ in range(views):
        f = max(height, width) * rng.uniform(0.8, 1.2)
        K = np.array([[f, 0.01 * f, width * 0.47], [0, f * 1.05, height * 0.52], [0, 0, 1]])
        c2w = np.eye(4)
        c2w[:3, :3] = quats_to_matrices(normalize_quats(np.array([1, *rng.uniform(-turn, turn, 3)])))
        c2w[:3, 3] = rng.uniform(-0.3, 0.3, 3) + (0 if centre is None else centre)
        cameras.append(Camera(K, c2w, width, height))
    return cameras


def make_gaussians(
    views: int = 2,
    height: int = 24,
    width: int = 32,
    degree: int = 1,
    *,
    seed: int = 0,
    layers: int = 1,
    origin: NDArray | None = None,
) -> Gaussians:
    """Smooth per-pixel Gaussians, as a network might predict: one per pixel of every view, z between 2 and 4."""
    origin = np.zeros(3) if origin is None else np.asarray(origin, np.float64)
    cameras = make_cameras(views, height, width, seed=seed, centre=origin)
    first = _per_pixel(cameras, degree, seed, origin)
    extra = []
    for n in range(1, layers):
        coarse = make_cameras(views, -(-height // 4) + n, -(-width // 4) + n, seed=seed, centre=origin)
        coarse = [Camera(c.K, full.c2w, c.width, c.height) for c, full in zip(coarse, cameras, strict=True)]
        extra.append(_per_pixel(coarse, 0, seed + n, origin))
    return Gaussians(
        first.means, first.quats, first.scales, first.opacities, first.sh, tuple(cameras), origin, tuple(extra)
    )


def _per_pixel(cameras: list[Camera], degree: int, seed: int, origin: NDArray) -> Gaussians:
    rng = np.random.default_rng(seed + 1000)
    height, width = cameras[0].height, cameras[0].width
    v, u = np.mgrid[:height, :width] + 0.5
    grid = (len(cameras), height, width)
    means = np.empty((*grid, 3))
    for i, camera in enumerate(cameras):
        z = 3 + np.sin(u / 7 + i) * np.cos(v / 5) + 0.01 * rng.standard_normal((height, width))
        pixels = np.stack([u + rng.uniform(-0.4, 0.4, u.shape), v, np.ones_like(u)], axis=-1)
        rays = pixels @ np.linalg.inv(camera.K).T
        means[i] = (rays * z[..., None]) @ camera.c2w[:3, :3].T + camera.centre - origin
    quats = np.array([1.0, 0.2, -0.1, 0.3]) + 0.2 * rng.standard_normal((*grid, 4))
    quats[rng.random(grid) < 0.3] *= -1
    scales = 0.02 * np.exp(0.3 * rng.standard_normal((*grid, 3)))
    functions = (degree + 1) ** 2
    sh = rng.standard_normal((*grid, functions, 3)) * 0.5 / (1 + np.arange(functions))[:, None]
    return Gaussians(means, quats, scales, rng.uniform(0.1, 1, grid), sh, tuple(cameras), origin)
