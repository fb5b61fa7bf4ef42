"""Photos without cameras, or a video, to a scene folder.

1. What there is: photos of a folder, frames of a video (`video.py`), or faces of 360° pictures (`faces.py`).
2. Each of these chooses among them, writes them to a working folder, and has them placed (`placing.py`).
3. The world is turned upright (`level.py`), and photos, cameras and points are written (`folder.py`).
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tinysplat_runtime.errors import InputError, warn
from tinysplat_runtime.gaussian.level import Level
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.footage import SUFFIXES as VIDEOS
from tinysplat_runtime.scene.intake.depths import observed_range
from tinysplat_runtime.scene.spacing import Spacing
from tinysplat_runtime.system.told import NOBODY, Told

from .faces import is_panorama, taken_as_faces
from .folder import write_folder
from .level import upright
from .model import coloured_points, placed_photos
from .photos import photo_names, photos_at, taken_as_photos
from .placing import Taken
from .remarks import remarks
from .request import PosesRequest
from .video import taken_as_frames


class Posed(NamedTuple):
    """A scene that was written.

    Attributes:
        cameras: of its photos, by their names in the working folder.
        near, far: between which depths it lies; None where nothing tells.
        level: what turned it upright.
    """

    cameras: dict[str, Camera]
    near: float | None
    far: float | None
    level: Level


def posed(request: PosesRequest, output: Path, told: Told = NOBODY) -> Posed:
    """Find where photos were taken, and write a scene of them.

    Args:
        request: see there.
        output: folder to write, new or empty.
        told: is told how far it is and what was found; what is left out is an `InputWarning` each.

    Raises:
        InputError: photos that cannot be read, that are too few, or of which too few could be placed.
    """
    source = photos_at(Path(request.photos))
    request = replace(request, photos=source)
    is_video = source.suffix.lower() in VIDEOS and not source.is_dir()
    if request.frames is not None and not is_video:
        raise InputError(f"given with {source}, expected a video ({', '.join(VIDEOS)})", where="frames")
    found = [] if is_video else photo_names(source)
    is_whole = is_panorama(request, [source] if is_video else [source / name for name in found])
    _check_output(output)
    with tempfile.TemporaryDirectory() as work:
        photos = Path(work) / "photos"
        photos.mkdir()
        try:
            if is_whole:
                taken = taken_as_faces(request, found, photos, told)
            elif is_video:
                taken = taken_as_frames(request, photos, told)
            else:
                taken = taken_as_photos(request, found, photos, told)
            scene = _written(output, photos, taken, told)
        except InputError as error:
            where = (error.where or str(source)).replace(str(photos), str(source))
            raise InputError(error.message, where=where) from None
    for line in remarks(taken.names, taken.placement, "frame" if is_video else "photo"):
        warn(f"{source}: {line}")
    doubt = "" if scene.level.is_sure else ", which is not sure"
    told.say("notice", f"turned upright to ± {scene.level.off:.1f}°{doubt}, from {scene.level.evidence}", source)
    if scene.near and scene.far:
        spacing = Spacing.of(list(scene.cameras.values()), scene.near, scene.far)
        told.say("notice", spacing.said([taken.names[name] for name in scene.cameras]), source)
    return scene


def _written(output: Path, photos: Path, taken: Taken, told: Told) -> Posed:
    """Write the scene of photos that were placed, upright."""
    model, right = taken.placement.model, taken.placement.right
    (points, colours, errors), (entries, observations) = coloured_points(model), placed_photos(model)
    kept = np.array([entry["name"] in right for entry in entries])
    w2c = np.array([entry["w2c"] for entry in entries])
    near, far = observed_range(w2c, points, observations[kept[observations[:, 0]]])
    placed, points, level = upright([entry for entry in entries if entry["name"] in right], points, taken.gravity)
    cameras = write_folder(output, photos, placed, (near, far), (points, colours, errors), taken.masks, told)
    return Posed(cameras, near, far, level)


def _check_output(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("exists and is not an empty folder", where=str(folder))
    if not folder.resolve().parent.is_dir():
        raise InputError(f"folder {folder.parent} does not exist; create it first", where=str(folder))
