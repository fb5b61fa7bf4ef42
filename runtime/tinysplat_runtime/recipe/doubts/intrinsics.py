"""Intrinsics that no photo has, and units in which nothing is drawn, by their numbers alone."""

import math

import numpy as np

from ...render.renderer import NEAR_PLANE
from ...scene.cameras import Camera
from .seen import Seen

LARGEST_SKEW = 0.01
"""Skew over focal length that pixels of no camera have."""

BORDER = 0.1
"""Share of a photo's width and height at its sides, where no principal point lies even if it was cut from another."""


def impossible(seen: Seen) -> list[str]:
    """Intrinsics that no photo has."""
    for name, camera, frame in zip(seen.names, seen.cameras, seen.frames, strict=True):
        if frame.lens is not None:
            pinhole = frame.lens.camera(np.eye(4))
            if 2 * pinhole.width < frame.lens.width or 2 * pinhole.height < frame.lens.height:
                sizes = f"{frame.lens.width}x{frame.lens.height} to {pinhole.width}x{pinhole.height}"
                return [f"{name}: its distortion (k1, k2, …) shrinks it from {sizes} pixels, as that of no lens does"]
        if text := _off_centre(camera):
            return [f"{name}: {text}"]
        skew = camera.K[0, 1] / camera.K[0, 0]
        if abs(skew) > LARGEST_SKEW:
            fault = f"K has a skew of {skew:.0%} of the focal length, which photos do not have: K[0][1] is 0"
            return [f"{name}: {fault}"]
    return []


def too_near(seen: Seen) -> list[str]:
    """Units of the poses in which most of a scene is nearer than what is drawn."""
    near, middle, far = (float(seen.depths[i]) for i in (0, len(seen.depths) // 2, -1))
    if middle > NEAR_PLANE:
        return []
    larger = 10.0 ** math.ceil(-math.log10(near))
    drawn = f"nothing nearer than {NEAR_PLANE:g} is drawn"
    return [f"depths of {near:.2g} to {far:.2g} units, where {drawn}: poses {larger:.0e} times as large show them"]


def _off_centre(camera: Camera) -> str:
    """What to say of a principal point that no photo has, which lies at the border or beyond."""
    x, y = camera.K[0, 2] / camera.width, camera.K[1, 2] / camera.height
    if max(abs(x - 0.5), abs(y - 0.5)) <= 0.5 - BORDER:
        return ""
    place = f"({100 * x:.0f} %, {100 * y:.0f} %) of width and height"
    return f"K's principal point lies at {place}, where it is near (50 %, 50 %): of another size of photo, or missing"
