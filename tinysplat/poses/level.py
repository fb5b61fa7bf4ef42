"""A world that was found from photos, which lies anyhow, turned and shifted so that it stands upright."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.editing import moved_camera
from tinysplat_runtime.gaussian.level import Level, level_of
from tinysplat_runtime.scene.lenses import Lens
from tinysplat_runtime.system.jsonfields import JsonObject

LEAST_HELD, MOST_ASKEW = 0.5, 0.6
"""Share of gravity that lies along a photo's sides at least, and how much across over how much down at most: where it
was taken straight down or the phone held diagonally, nothing says which side of it is down."""


def upright(
    entries: Sequence[JsonObject], points: NDArray, gravity: Mapping[str, tuple[float, float, float]]
) -> tuple[list[JsonObject], NDArray, Level]:
    """Photos and points of a world with y down, the ground at 0 and the middle of what is looked at above or on it.

    Args:
        entries: what `model.placed_photos` says of each.
        points: (N, 3), on surfaces.
        gravity: by name, what `exif.gravity` says of photos that say it.

    Returns:
        The photos and points in the new world, and what moved them.
    """
    cameras, falls = [], []
    for entry in entries:
        stated = entry["camera"]
        lens = Lens(stated["model"], tuple(stated["params"]), stated["width"], stated["height"])
        cameras.append(lens.camera(np.linalg.inv(np.vstack([entry["w2c"], [0, 0, 0, 1]]))))
        if (seen := falling(*gravity.get(entry["name"], (0.0, 0.0, 0.0)))) is not None:
            falls.append(seen @ cameras[-1].rotation)
    level = level_of(cameras, points, falls=np.array(falls) if falls else None)
    R, t = level.rotation, level.translation
    moved = [moved_camera(camera, R, 1, t).w2c[:3].tolist() for camera in cameras]
    placed = [{**entry, "w2c": w2c} for entry, w2c in zip(entries, moved, strict=True)]
    return placed, points @ R.T + t, level


def falling(right: float, top: float, out: float) -> NDArray | None:
    """Which way things fall in a photo as it is seen, a unit vector of its camera, of a vector of `exif.gravity`.

    Phones store photos such that they are seen upright: of four ways to turn one, the way in which things fall most
    downwards. None where that is not clear, or the phone was shaken.
    """
    x, y = right, -top
    across, down = max(((x, y), (-y, x), (-x, -y), (y, -x)), key=lambda turned: turned[1])
    size = float(np.linalg.norm((right, top, out)))
    if not 0.8 < size < 1.2 or down < LEAST_HELD * size or abs(across) > MOST_ASKEW * down:
        return None
    return np.array([across, down, -out]) / size
