"""Where a page begins: the view that shows most of what all do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..scene.cameras import Camera
from ..scene.frusta import points_seen, sees
from ..scene.look import range_guessed


def front_view(cameras: Sequence[Camera]) -> int:
    """Index of the camera that has most of what all have in their frames, of equal ones the first; 0 of none."""
    if len(cameras) < 2:
        return 0
    near, far = range_guessed(cameras)
    points = np.concatenate([points_seen(camera, near, far) for camera in cameras])
    return int(np.argmax([sees(camera, points, near, far).sum() for camera in cameras]))
