"""Which pixels of a target can be known from the context views at all: by cameras and depth range, not by any model.

A feedforward network is asked for what stands beyond its photos' frames too; PSNR over the pixels that some photo shows
says how well it does what it can.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.scene.cameras import Camera

DEPTHS = 16
"""Places along a pixel's ray, uniform in inverse depth from far to near."""

SHARE = 0.5
"""Share of them that must lie in the frame of a context view."""


def covered_pixels(target: Camera, context: Sequence[Camera], near: float, far: float) -> NDArray:
    """Pixels whose ray runs inside the context views' frames: (H, W) bool.

    A place counts where any context view has it before its camera and within its picture, occluded or not. With
    targets between the contexts this leaves out the margins that no photo shows, whatever stands there.

    Args:
        target: the view looked at.
        context: the views that a network gets.
        near, far: z of the nearest and the farthest surface, scene units, 0 < near < far.
    """
    row, column = np.mgrid[: target.height, : target.width] + 0.5
    pixels = np.stack([column, row, np.ones_like(row)], axis=-1)
    rays = pixels @ np.linalg.inv(target.K).T @ target.c2w[:3, :3].T  # world, unit z in the target's frame
    inside = np.zeros((target.height, target.width))
    for inverse_depth in np.linspace(1 / far, 1 / near, DEPTHS):
        points = target.c2w[:3, 3] + rays / inverse_depth
        inside += np.any([_in_frame(points, camera) for camera in context], axis=0)
    return inside >= SHARE * DEPTHS


def _in_frame(points: NDArray, camera: Camera) -> NDArray:
    """Where world points (H, W, 3) appear in a camera's picture: (H, W) bool."""
    shown = (points - camera.c2w[:3, 3]) @ camera.c2w[:3, :3] @ camera.K.T
    z = shown[..., 2]
    x, y = (shown[..., i] / np.where(z > 0, z, 1) for i in (0, 1))
    return (z > 0) & (x >= 0) & (x <= camera.width) & (y >= 0) & (y <= camera.height)
