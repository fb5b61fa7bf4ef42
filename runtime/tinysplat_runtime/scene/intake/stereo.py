"""A rectified stereo pair: two photos, a focal length and a baseline make a scene."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...system.files import StrPath
from ..cameras import Camera, intrinsics, posed
from ..images import image_size
from ..scenes import Frame, Scene


def stereo_scene(
    left: StrPath, right: StrPath, focal: float, baseline: float, near: float | None = None, far: float | None = None
) -> Scene:
    """Two photos of parallel cameras side by side; the world's frame is the left one's.

    Args:
        left: photo of the camera on the left.
        right: photo of the camera `baseline` to its right, rectified: points lie in the same row of both.
        focal: focal length of both in pixels; the principal point is the centre of the photo.
        baseline: distance of the cameras; its unit is the scene's.
        near, far: depths of the nearest and the farthest surface, in the baseline's unit.

    Raises:
        InputError: names the photo or the option at fault.
    """
    for name, value in (("--focal", focal), ("--baseline", baseline)):
        if not 0 < value < float("inf"):
            raise InputError(f"{value:g}, expected a number above 0", where=name)
    sizes = [image_size(photo) for photo in (left, right)]
    if sizes[0] != sizes[1]:
        both = " and ".join(f"{width}x{height}" for height, width in sizes)
        raise InputError(f"photos of {both} pixels, expected a rectified pair of one size", where=str(right))
    height, width = sizes[0]
    here = Camera(intrinsics(focal, focal, width / 2, height / 2), np.eye(4), width, height)
    beside = replace(here, c2w=posed(np.eye(3), np.array([baseline, 0, 0])))
    frames = Frame(here, Path(left)), Frame(beside, Path(right))
    return Scene(Path(left).parent, frames, near, far)
