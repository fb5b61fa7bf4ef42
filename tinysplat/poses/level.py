"""A world that was found from photos, which lies anyhow, turned and shifted so that it stands upright."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.editing import moved_camera
from tinysplat_runtime.gaussian.level import Level, level_of
from tinysplat_runtime.scene.lenses import Lens
from tinysplat_runtime.system.jsonfields import JsonObject


def upright(entries: Sequence[JsonObject], points: NDArray) -> tuple[list[JsonObject], NDArray, Level]:
    """Photos and points of a world with y down, the ground at 0 and the middle of what is looked at above or on it.

    Args:
        entries: what `model.placed_photos` says of each.
        points: (N, 3), on surfaces.

    Returns:
        The photos and points in the new world, and what moved them.
    """
    cameras = []
    for entry in entries:
        stated = entry["camera"]
        lens = Lens(stated["model"], tuple(stated["params"]), stated["width"], stated["height"])
        cameras.append(lens.camera(np.linalg.inv(np.vstack([entry["w2c"], [0, 0, 0, 1]]))))
    level = level_of(cameras, points)
    R, t = level.rotation, level.translation
    moved = [moved_camera(camera, R, 1, t).w2c[:3].tolist() for camera in cameras]
    placed = [{**entry, "w2c": w2c} for entry, w2c in zip(entries, moved, strict=True)]
    return placed, points @ R.T + t, level
