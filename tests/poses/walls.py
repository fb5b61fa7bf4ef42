"""Photos of textured walls, which structure from motion finds its way in."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scenes import make_cameras

from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.pictures import write_png

HEIGHT, WIDTH, FOCAL = 240, 320, 300.0


def textured(seed: int) -> NDArray:
    """(600, 800, 3) of blobs of many sizes, which feature detectors like."""
    rng = np.random.default_rng(seed)
    image = np.full((600, 800, 3), 120.0)
    v, u = np.mgrid[:600, :800]
    for _ in range(700):
        x, y, radius = rng.uniform(0, 800), rng.uniform(0, 600), rng.uniform(2, 14)
        left, top, side = int(max(x - 3 * radius, 0)), int(max(y - 3 * radius, 0)), int(6 * radius) + 1
        window = np.s_[top : top + side, left : left + side]
        blob = np.exp(-((u[window] - x) ** 2 + (v[window] - y) ** 2) / (2 * radius**2))
        image[window] += blob[..., None] * rng.uniform(-120, 120, 3)
    return image.clip(0, 255)


def photograph(camera: Camera, walls: list[tuple[float, float, NDArray]]) -> NDArray:
    """Fronto-parallel textured walls (z, half width, texture), the nearest in sight first."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(camera.K).T @ camera.rotation
    photo = np.zeros((HEIGHT, WIDTH, 3))
    for z, half, texture in sorted(walls, key=lambda wall: -wall[0]):
        hit = camera.centre + rays * ((z - camera.centre[2]) / rays[..., 2])[..., None]
        x, y = (hit[..., 0] / half + 1) * 400, (hit[..., 1] / half + 0.75) * 400
        inside = (x >= 0) & (x < 799) & (y >= 0) & (y < 599)
        i, j = np.where(inside, y, 0).astype(int), np.where(inside, x, 0).astype(int)
        s, t = (np.where(inside, y, 0) - i)[..., None], (np.where(inside, x, 0) - j)[..., None]
        value = (texture[i, j] * (1 - s) + texture[i + 1, j] * s) * (1 - t)
        value += (texture[i, j + 1] * (1 - s) + texture[i + 1, j + 1] * s) * t
        photo[inside] = value[inside]
    return photo.round().astype(np.uint8)


def write_photos_of_walls(
    folder: Path, views: int, spacing: float = 0.35, focals: Sequence[float] = (FOCAL,)
) -> list[Camera]:
    """Write photos 0.png, 1.png … of two walls, of these focal lengths by turns, into a new folder; their cameras."""
    walls = [(6.0, 5.0, textured(0)), (3.5, 0.8, textured(1))]
    cameras = [
        Camera([[f, 0, WIDTH / 2], [0, f, HEIGHT / 2], [0, 0, 1]], camera.c2w, WIDTH, HEIGHT)
        for camera, f in zip(make_cameras(views, HEIGHT, WIDTH, spacing=spacing), cycle(focals), strict=False)
    ]
    folder.mkdir()
    for i, camera in enumerate(cameras):
        write_png(folder / f"{i}.png", photograph(camera, walls))
    return cameras
