"""What cameras have in their frames between two depths, by a few points: for choosing photos, not for drawing."""

import numpy as np
from numpy.typing import NDArray

from .cameras import Camera

_GRID = (4, 3)  # columns and rows of points in each picture
_DEPTHS = 3


def points_seen(camera: Camera, near: float, far: float) -> NDArray:
    """(P, 3) float64 world points on a few planes of even inverse depth through the picture."""
    columns, rows = _GRID
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    pixels = np.stack([u.ravel() * camera.width, v.ravel() * camera.height, np.ones(u.size)], axis=1)
    rays = pixels @ np.linalg.inv(camera.K).T @ camera.rotation  # (P, 3), z = 1 in the camera
    depths = 1 / np.linspace(1 / near, 1 / far, _DEPTHS)
    return (camera.centre + rays * depths[:, None, None]).reshape(-1, 3)


def sees(camera: Camera, points: NDArray, near: float, far: float) -> NDArray:
    """(P,) whether a point lies in the picture, and not far nearer or farther than the scene does."""
    local = (points - camera.centre) @ camera.rotation.T
    z = local[:, 2]
    pixels = local @ camera.K.T
    inside = ((pixels[:, :2] >= 0) & (pixels[:, :2] <= pixels[:, 2:] * (camera.width, camera.height))).all(axis=1)
    return inside & (z > near / 2) & (z < 2 * far)


def middle_depth(points: NDArray, camera: Camera) -> float:
    """The median depth z of the world points (P, 3) that lie before a camera, scene units; 1 where none does."""
    z = (points - camera.centre) @ camera.rotation[2]
    return float(np.median(z[z > 0])) if (z > 0).any() else 1.0
