"""Which of a scene's photos a view was taken as: the one whose camera stands at its place and is turned alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .cameras import Camera
from .scenes import Scene

SAME_PLACE = 1e-3
"""Largest distance of a photo's camera from a view's, as a share of `reach_of` the views, and largest difference of
their rotations' entries."""


def reach_of(cameras: Sequence[Camera]) -> float:
    """The greatest distance between two of the cameras, in scene units."""
    centres = np.stack([camera.centre for camera in cameras])
    return float(np.linalg.norm(centres[:, None] - centres, axis=-1).max())


def taken_as(view: Camera, scene: Scene, reach: float) -> int | None:
    """The photo that a view was taken as, if any.

    Args:
        view: whose pose is looked for.
        scene: the photos.
        reach: of all views.
    """
    away = [float(np.linalg.norm(frame.camera.centre - view.centre)) for frame in scene.frames]
    turned = [float(np.abs(frame.camera.rotation - view.rotation).max()) for frame in scene.frames]
    fits = [i for i in range(len(away)) if away[i] <= SAME_PLACE * reach and turned[i] <= SAME_PLACE]
    return min(fits, key=away.__getitem__, default=None)
