"""Tiny synthetic scenes that tests share: cameras in a row, Gaussians in front of them, photos on disk.

    from scenes import make_cameras, make_gaussians, write_scene

Everything is a function of its arguments: the same call gives the same arrays.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.cameras import Camera
from tinysplat_runtime.gaussians import FIELDS, Gaussians
from tinysplat_runtime.images import write_png

NEAR, FAR = 1.5, 8.0


def make_cameras(views: int = 2, height: int = 8, width: int = 12, spacing: float = 0.2) -> list[Camera]:
    """Cameras `spacing` apart along x, turned a little towards each other, principal point off the centre."""
    cameras = []
    for v in range(views):
        offset = v - (views - 1) / 2
        angle = -0.05 * offset
        c2w = np.eye(4)
        c2w[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        c2w[0, 3] = spacing * offset
        K = [[1.1 * width, 0, 0.5 * width + 0.3], [0, 1.1 * width, 0.5 * height - 0.2], [0, 0, 1]]
        cameras.append(Camera(K, c2w, width=width, height=height))
    return cameras


def make_gaussians(
    views: int = 2, height: int = 8, width: int = 12, degree: int = 1, layers: int = 1, seed: int = 0
) -> Gaussians:
    """Per-pixel Gaussians (V, H, W) on the rays of `make_cameras`, between NEAR and FAR.

    Every further layer has half the rows and columns of the one before (at least 1) and wider Gaussians.
    """
    rng = np.random.default_rng(seed)
    made = []
    for n in range(layers):
        cameras = make_cameras(views, max(height >> n, 1), max(width >> n, 1))
        made.append(_pixel_gaussians(cameras, degree, rng))
    first, *rest = made
    return Gaussians(**{name: getattr(first, name) for name in FIELDS}, cameras=first.cameras, extra_layers=tuple(rest))


def _pixel_gaussians(cameras: Sequence[Camera], degree: int, rng: np.random.Generator) -> Gaussians:
    lead = (len(cameras), cameras[0].height, cameras[0].width)
    depth = rng.uniform(NEAR, FAR, lead)
    y, x = np.mgrid[0 : lead[1], 0 : lead[2]] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)  # (H, W, 3)
    rays = np.stack([pixels @ np.linalg.inv(c.K).T @ c.c2w[:3, :3].T for c in cameras])  # (V, H, W, 3), z = 1
    centres = np.stack([c.centre for c in cameras])[:, None, None]
    pixel_footprint = (depth / cameras[0].focal)[..., None]
    return Gaussians(
        means=centres + rays * depth[..., None],
        quats=rng.normal(size=(*lead, 4)),
        scales=pixel_footprint * rng.uniform(0.3, 1.5, (*lead, 3)),
        opacities=rng.uniform(0.05, 1, lead),
        sh=rng.normal(scale=0.3, size=(*lead, (degree + 1) ** 2, 3)),
        cameras=tuple(cameras),
    )


def make_photo(height: int, width: int, seed: int = 0) -> NDArray:
    """(H, W, 3) uint8 with smooth colours and edges."""
    y, x = np.mgrid[0:height, 0:width] / max(height, width)
    phase = np.random.default_rng(seed).uniform(0, 6, 3)
    waves = [np.sin(9 * x + p) + np.cos(7 * y - p) + (x + y > 0.3 * p) for p in phase]
    return (np.stack(waves, axis=-1) * 40 + 100).clip(0, 255).astype(np.uint8)


def scene_document(cameras: Sequence[Camera]) -> dict[str, object]:
    """What `cameras.json` holds for photos named images/0000.png and so on."""
    frames = [
        {
            "file": f"images/{i:04}.png",
            "width": c.width,
            "height": c.height,
            "K": c.K.tolist(),
            "c2w": c.c2w.tolist(),
        }
        for i, c in enumerate(cameras)
    ]
    return {"near": NEAR, "far": FAR, "frames": frames}


def write_scene(folder: Path, views: int = 3, height: int = 24, width: int = 32) -> Path:
    """Write a scene folder of PNG photos and `cameras.json`; returns the folder."""
    cameras = make_cameras(views, height, width)
    (folder / "images").mkdir(parents=True)
    for i in range(views):
        write_png(folder / "images" / f"{i:04}.png", make_photo(height, width, seed=i))
    (folder / "cameras.json").write_text(json.dumps(scene_document(cameras)))
    return folder
