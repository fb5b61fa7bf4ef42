"""Where the photos of a list of Gaussians were taken, as files beside it say.

scene/cameras.json                                  of scene/point_cloud/iteration_30000/point_cloud.ply, as 3DGS
                                                    writes both
room.cameras.json                                   of room.ply, room.splat and so on, as `decode --fuse` writes it
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..errors import InputError, warn
from ..gaussian.gaussians import Gaussians
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
    if not isinstance(cameras, Sequence) or isinstance(cameras, str):
        from ..scene.intake.layouts import load_cameras

        cameras = load_cameras(cameras)
    if not cameras or not all(isinstance(camera, Camera) for camera in cameras):
        raise InputError("none, expected a list of cameras or the path of a scene", where="cameras")
    return replace(gaussians, viewpoints=tuple(cameras))


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
