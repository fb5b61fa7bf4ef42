"""A ray-traced scene with exact depth: a textured square in front of a textured wall, seen by cameras in a row.

scene = trace(views=2, height=96, width=128)
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scenes import make_cameras, scene_document

from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.scenes import Frame, Scene

if TYPE_CHECKING:
    from torch import Tensor

WALL_Z, SQUARE_Z, SQUARE_HALF = 6.0, 3.0, 0.55
NEAR, FAR = 2.0, 12.0
SUBPIXELS = 3


@dataclass(frozen=True)
class TracedScene:
    """Photos (V, H, W, 3) float32, exact z (V, H, W) float64 through the pixel centres, and cameras."""

    images: NDArray
    depth: NDArray
    cameras: tuple[Camera, ...]


def scene_of(images: NDArray, cameras: Sequence[Camera]) -> Scene:
    """Photos (V, H, W, 3) that are in no files, and their cameras."""
    pairs = zip(images, cameras, strict=True)
    return Scene(Path(), tuple(Frame(camera, Path(), kept={"image": image}) for image, camera in pairs), NEAR, FAR)


def row_of_cameras(views: int, height: int, width: int, spacing: float = 0.2) -> tuple[Camera, ...]:
    """Cameras along x, each turned a little, with the principal point off the centre."""
    return tuple(make_cameras(views, height, width, spacing, turn=0.03, focal=1, shift=(0.7, -0.4)))


def trace(views: int, height: int, width: int, spacing: float = 0.2, subpixels: int = SUBPIXELS) -> TracedScene:
    """Render the scene with `subpixels`² rays per pixel."""
    cameras = row_of_cameras(views, height, width, spacing)
    images, depths = [], []
    for camera in cameras:
        centres = (np.arange(subpixels) + 0.5) / subpixels
        shots = [_shoot(camera, dx, dy)[0] for dy in centres for dx in centres]
        images.append(np.mean(shots, axis=0))
        depths.append(_shoot(camera, 0.5, 0.5)[1])
    return TracedScene(np.float32(images), np.array(depths), cameras)


def network_inputs(
    images: NDArray, cameras: Sequence[Camera], near: float = NEAR, far: float = FAR
) -> dict[str, NDArray]:
    """What a network's graph is fed with, photos (V, H, W, 3) of any values among it: nothing is checked or moved."""
    return {
        "images": np.ascontiguousarray(images.transpose(0, 3, 1, 2), np.float32),
        "K": np.float32([camera.K_unit for camera in cameras]),
        "c2w": np.float32([camera.c2w for camera in cameras]),
        "near": np.full(len(cameras), near, np.float32),
        "far": np.full(len(cameras), far, np.float32),
    }


def network_tensors(scene: TracedScene, near: float = NEAR, far: float = FAR) -> tuple[Tensor, ...]:
    """The same of a scene, for a network in torch."""
    import torch

    return tuple(map(torch.from_numpy, network_inputs(scene.images, scene.cameras, near, far).values()))


def _shoot(camera: Camera, dx: float, dy: float) -> tuple[NDArray, NDArray]:
    """Colours (H, W, 3) and camera z (H, W) of the rays through the offset (dx, dy) in every pixel."""
    row, column = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([column + dx, row + dy, np.ones_like(row, float)], axis=-1)
    directions = pixels @ np.linalg.inv(camera.K).T @ camera.rotation  # camera z = 1, in world axes
    t_wall, t_square = ((z - camera.centre[2]) / directions[..., 2] for z in (WALL_Z, SQUARE_Z))
    wall, square = (camera.centre + t[..., None] * directions for t in (t_wall, t_square))
    hit = (np.abs(square[..., :2]) < SQUARE_HALF).all(axis=-1)
    colour = np.where(hit[..., None], _texture(square, 5.0, 1.0), _texture(wall, 2.5, 0.0))
    return colour, np.where(hit, t_square, t_wall)


def _texture(points: NDArray, frequency: float, phase: float) -> NDArray:
    """Colours in [0.1, 0.9] without a period inside the frame: waves of unrelated frequencies and directions."""
    x, y = points[..., 0] * frequency, points[..., 1] * frequency
    waves = [
        np.sin(1.0 * x + 0.7 * y + phase + c) + np.sin(2.3 * y - 1.1 * x + 2 * c) + np.sin(3.7 * x + 1.9 * y * (c + 1))
        for c in range(3)
    ]
    return 0.5 + 0.4 / 3 * np.stack(waves, axis=-1)


def write_traced(folder: Path, traced: TracedScene, depths: tuple[float, ...] = ()) -> Path:
    """Write a scene folder of the traced photos, whose cameras state these depths or none; returns the folder."""
    (folder / "images").mkdir()
    for i, image in enumerate(traced.images):
        write_png(folder / "images" / f"{i:04}.png", image)
    document = {"frames": scene_document(traced.cameras)["frames"], **dict(zip(("near", "far"), depths, strict=False))}
    (folder / "cameras.json").write_text(json.dumps(document))
    return folder
