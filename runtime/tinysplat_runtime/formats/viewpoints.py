"""Where the photos of a list of Gaussians were taken, as files beside it say.

scene/cameras.json                                  of scene/point_cloud/iteration_30000/point_cloud.ply, as 3DGS
                                                    writes both
room.cameras.json                                   of room.ply, room.splat and so on, as `decode --fuse` writes it
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..errors import InputError, warn
from ..gaussian.gaussians import FIELDS, Gaussians
from ..scene.cameras import Camera
from ..system.files import StrPath, write_atomically

SUFFIX = ".cameras.json"


def seen_from(gaussians: Gaussians, cameras: Sequence[Camera] | StrPath) -> Gaussians:
    """A list with the cameras of its photos, or with those that `load_cameras` reads.

    Raises:
        InputError: Gaussians that are pixels of cameras, or a file at fault.
    """
    if gaussians.is_per_pixel:
        fault = "given, but the Gaussians are the pixels of cameras of their own; expected a list"
        raise InputError(fault, where="cameras")
    return replace(gaussians, viewpoints=_cameras(cameras))


def pixels_of(gaussians: Gaussians, cameras: Sequence[Camera] | StrPath) -> Gaussians:
    """As `seen_from`, but a list of as many Gaussians as the cameras have pixels becomes these pixels, in C order."""
    views = _cameras(cameras)
    grid = (len(views), views[0].height, views[0].width)
    if gaussians.is_per_pixel or gaussians.count != math.prod(grid) or gaussians.extra_layers:
        return seen_from(gaussians, views)
    fields = {name: getattr(gaussians, name) for name in FIELDS}
    lead = gaussians.opacities.ndim
    on_grid = {name: array.reshape(*grid, *array.shape[lead:]) for name, array in fields.items()}
    return replace(gaussians, **on_grid, cameras=views, viewpoints=())


def _cameras(given: Sequence[Camera] | StrPath) -> tuple[Camera, ...]:
    if not isinstance(given, Sequence) or isinstance(given, str):
        from ..scene.intake.layouts import load_cameras

        given = load_cameras(given)
    if not given or not all(isinstance(camera, Camera) for camera in given):
        raise InputError("none, expected a list of cameras or the path of a scene", where="cameras")
    return tuple(given)


def cameras_beside(path: Path) -> tuple[Camera, ...]:
    """Cameras that a file beside a list of Gaussians has; none, and a warning, where it cannot be read."""
    file = path.with_suffix(SUFFIX)
    folder = path.absolute().parent
    if folder.name.startswith("iteration_") and folder.parent.name == "point_cloud" and not file.is_file():
        file = folder.parent.parent / "cameras.json"
    if not file.is_file():
        return ()
    from ..scene.intake.layouts import load_cameras

    try:
        return tuple(load_cameras(file))
    except InputError as error:
        warn(f"{error}; not used")
        return ()


def save_beside(path: Path, gaussians: Gaussians) -> Path:
    """Write the viewpoints of Gaussians beside their file; where."""
    from ..scene.intake.cameras_json import camera_entry

    frames = [camera_entry(f"{number:05d}", camera) for number, camera in enumerate(gaussians.viewpoints)]
    file = path.with_suffix(SUFFIX)
    write_atomically(file, json.dumps({"frames": frames}).encode())
    return file
