"""Where the photos of a list of Gaussians were taken, as files beside it say.

scene/cameras.json                                  of scene/point_cloud/iteration_30000/point_cloud.ply, as 3DGS
                                                    writes both
room.cameras.json                                   of room.ply, room.splat and so on, as `encode -o` writes it
cameras.json, transforms.json, sparse/0             of what lies beside them, as of OpenSplat, nerfstudio and COLMAP;
                                                    dataparser_transforms.json says how nerfstudio moved what it trained
"""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import InputError, warn, within
from ..gaussian.editing import moved_camera
from ..gaussian.gaussians import FIELDS, Gaussians
from ..scene.cameras import Camera, finite_array
from ..system.files import StrPath, parsing, read_limited, write_atomically
from ..system.jsonfields import parse_json

SUFFIX = ".cameras.json"
CAMERAS_FILE, TRANSFORMS_FILE, MOVED_FILE = "cameras.json", "transforms.json", "dataparser_transforms.json"


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


def found_beside(path: Path) -> Path | None:
    """The file or folder beside a list of Gaussians that has cameras of its photos; None where there is none."""
    from ..scene.intake.colmap import model_folder

    own, folder = path.with_suffix(SUFFIX), path.absolute().parent
    if own.is_file():
        return own
    if folder.name.startswith("iteration_") and folder.parent.name == "point_cloud":
        model = folder.parent.parent / CAMERAS_FILE
        if model.is_file():
            return model
    for name in (CAMERAS_FILE, TRANSFORMS_FILE):
        if (folder / name).is_file():
            return folder / name
    return folder if model_folder(folder) is not None else None


def cameras_beside(path: Path) -> tuple[Camera, ...]:
    """Cameras that a file beside a list of Gaussians has; none, and a warning, where it cannot be read."""
    file = found_beside(path)
    if file is None:
        return ()
    from ..scene.intake.layouts import load_cameras

    try:
        cameras = load_cameras(file)
        moved = file.parent / MOVED_FILE
        return tuple(_as_trained(cameras, moved, file) if file.name == TRANSFORMS_FILE and moved.is_file() else cameras)
    except InputError as error:
        warn(f"{error}; not used")
        return ()


def _as_trained(cameras: Sequence[Camera], moved: Path, transforms: Path) -> list[Camera]:
    """Cameras of a `transforms.json` where nerfstudio had them when it trained: s·(T·A⁻¹·x), T and s as it wrote them
    down and A what had been applied to the file's own cameras.
    """
    from ..scene.intake.fields import Fields
    from ..scene.scenes import MAX_CAMERAS_BYTES

    told, own = (Fields(parse_json(read_limited(file, MAX_CAMERAS_BYTES))) for file in (moved, transforms))
    identity = np.eye(4)[:3].tolist()
    with within(str(moved)):
        whole, applied = (
            np.vstack([finite_array(name, given.value(name, identity), (3, 4)), [0, 0, 0, 1]])
            for name, given in (("transform", told), ("applied_transform", own))
        )
        scale = told.number("scale", 1) / (own.number("applied_scale", 1) or 1)
        with parsing("applied_transform"):
            motion = whole @ np.linalg.inv(applied)
        return [moved_camera(camera, motion[:3, :3], scale, scale * motion[:3, 3]) for camera in cameras]


def save_beside(path: Path, gaussians: Gaussians) -> Path:
    """Write the viewpoints of Gaussians beside their file; where."""
    from ..scene.intake.cameras_json import camera_entry

    frames = [camera_entry(f"{number:05d}", camera) for number, camera in enumerate(gaussians.viewpoints)]
    file = path.with_suffix(SUFFIX)
    write_atomically(file, json.dumps({"frames": frames}).encode())
    return file
