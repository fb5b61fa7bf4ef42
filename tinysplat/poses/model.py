"""What a model of COLMAP's says: points, photos that have a place, and what these observe."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.system.jsonfields import JsonObject

if TYPE_CHECKING:
    from pycolmap import Reconstruction


def coloured_points(model: Reconstruction) -> tuple[NDArray, NDArray, NDArray]:
    """Points (N, 3) in the world, their colours (N, 3) uint8, and their errors (N,) in pixels."""
    points = list(model.points3D.values())
    return (
        np.array([point.xyz for point in points], np.float64).reshape(-1, 3),
        np.array([point.color for point in points], np.uint8).reshape(-1, 3),
        np.array([point.error for point in points], np.float64),
    )


def placed_photos(model: Reconstruction) -> tuple[list[JsonObject], NDArray]:
    """Photos that have a pose, and what they observe.

    Returns:
        A photo's `name`, `w2c` (3×4) and `camera` (model, params, width, height); and pairs (M, 2) int64 of an index
        into these and one into `coloured_points`.
    """
    points = {number: row for row, number in enumerate(model.points3D)}
    entries: list[JsonObject] = []
    observations: list[tuple[int, int]] = []
    for image in (image for image in model.images.values() if image.has_pose):
        camera = model.cameras[image.camera_id]
        seen = (point.point3D_id for point in image.points2D if point.has_point3D())
        observations += [(len(entries), points[number]) for number in seen if number in points]
        taken_with: JsonObject = {"model": camera.model.name, "params": [float(value) for value in camera.params]}
        taken_with |= {"width": int(camera.width), "height": int(camera.height)}
        pose = image.cam_from_world().matrix().tolist()
        entries.append({"name": image.name, "w2c": pose, "camera": taken_with})
    return entries, np.array(observations, np.int64).reshape(-1, 2)
