"""The depth range of a scene from points on its surfaces."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera

PERCENTILES = (1, 99)
"""Points beyond them are taken for outliers of the reconstruction."""

MARGIN = 1.1
"""Nearest and farthest depth are moved apart by it: points are sparse, and surfaces reach past them."""


def depth_range(depths: NDArray) -> tuple[float | None, float | None]:
    """(near, far) around the depths z > 0, float of any shape, scene units; (None, None) without any."""
    depths = depths[np.isfinite(depths) & (depths > 0)]
    if not depths.size:
        return None, None
    low, high = np.percentile(depths, PERCENTILES)
    return float(low / MARGIN), float(high * MARGIN)


def observed_range(w2c: NDArray, points: NDArray, observations: NDArray) -> tuple[float | None, float | None]:
    """`depth_range` over observations (M, 2): pairs of a row of world to camera (V, 3, 4) and of points (N, 3)."""
    views, seen = observations.T
    z = w2c[views, 2]  # (M, 4)
    return depth_range((z[:, :3] * points[seen]).sum(axis=1) + z[:, 3])


def depth_range_in_view(points: NDArray, cameras: Sequence[Camera]) -> tuple[float | None, float | None]:
    """`depth_range` of points (N, 3) float in the world as the cameras that have them in their picture see them."""
    depths = [np.zeros(0)]
    for camera in cameras:
        local = (points - camera.centre) @ camera.rotation.T  # (N, 3)
        local = local[local[:, 2] > 0]
        pixels = local @ camera.K.T
        with np.errstate(over="ignore"):
            ends = pixels[:, 2:] * (camera.width, camera.height)
        depths.append(local[((pixels[:, :2] >= 0) & (pixels[:, :2] < ends)).all(axis=1), 2])
    return depth_range(np.concatenate(depths))
