"""`transforms.json`, as NeRF (there `transforms_train.json`), instant-ngp and nerfstudio write it.

Poses are camera to world with OpenGL axes (x right, y up, z backward). Intrinsics stand at the top or in a frame, which
wins: `fl_x fl_y cx cy w h`, or the angle of view `camera_angle_x`; distortion `k1 k2 k3 k4 p1 p2` is OpenCV's, a
fisheye's where `camera_model` or `is_fisheye` says so. The depth range is that of the points in `ply_file_path`, in
the coordinates of the poses. Source: docs.nerf.studio, "Data conventions"; instant-ngp, docs/nerf_dataset_tips.md.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, warn
from ...system.files import parsing, read_limited
from ...system.jsonfields import depth, frame_entries, kind_of, parse_object, photo_name
from ..cameras import Camera, finite_array
from ..images import image_size
from ..lenses import Lens, opencv_lens
from ..scenes import MAX_CAMERAS_BYTES, Frame, Scene, even_sizes
from .depths import depth_range_in_view

FILE = "transforms.json"
BLENDER_FILE = "transforms_train.json"  # the synthetic scenes of NeRF have one for each use

OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Right factor of a camera-to-world matrix that turns its camera axes."""

_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_SUFFIXES = (".png", ".jpg", ".jpeg")  # for names without one, as in the synthetic NeRF scenes


def load_transforms(path: Path, near: float | None, far: float | None) -> Scene:
    """Read a folder with a `transforms.json`, or such a file.

    Raises:
        InputError: names the file and the field at fault.
    """
    file = path / (FILE if (path / FILE).exists() else BLENDER_FILE) if path.is_dir() else path
    try:
        document = parse_object(read_limited(file, MAX_CAMERAS_BYTES))
        frames = frames_of(file.parent, document, str(file))
        near = depth(document, "near") if near is None else near
        far = depth(document, "far") if far is None else far
        if near is None or far is None:
            depths = _depths_of_points(file.parent, document, [frame.camera for frame in frames])
            near, far = (given if given is not None else own for given, own in zip((near, far), depths, strict=True))
    except InputError as error:
        raise error if error.where and error.where.startswith(str(file.parent)) else error.within(str(file)) from None
    return Scene(file.parent, frames, near, far)


def frames_of(folder: Path, document: dict[str, Any], named: str) -> tuple[Frame, ...]:
    """The frames of a document whose photos are in a folder; all of them where none is, as beside a video.

    Raises:
        InputError: names the frame and its field.
    """
    entries = list(enumerate(frame_entries(document)))
    photos = [_photo(folder, photo_name(i, entry, "file_path")) for i, entry in entries]
    missing = [photo for photo in photos if not photo.is_file()]
    left_out = set(missing) if len(missing) < len(photos) else set()
    if left_out:
        text = f"{len(missing)} of {len(photos)} photos are not there and left out"
        names = ", ".join(photo.name for photo in missing[:3]) + (", …" if len(missing) > 3 else "")
        warn(f"{named}: {text} ({names})")
    chosen = zip(entries, photos, strict=True)
    return even_sizes([_frame(folder, document, *one, photo) for one, photo in chosen if photo not in left_out])


def _frame(folder: Path, document: dict[str, Any], i: int, entry: dict[str, Any], photo: Path) -> Frame:
    fields = {**document, **entry}
    try:
        lens = _lens(fields, photo)
        camera = lens.camera(_pose(entry))
    except InputError as error:
        if error.where and error.where.startswith(str(folder)):
            raise
        where = f"frames[{i}].{error.where}" if error.where else f"frames[{i}]"
        raise InputError(error.message, where=where) from None
    return Frame(camera, photo, lens=None if lens.is_pinhole else lens)


def _photo(folder: Path, name: str) -> Path:
    candidates = [folder / (name + suffix) for suffix in ("", *_SUFFIXES)]
    return next((candidate for candidate in candidates if candidate.is_file()), candidates[0])


def _pose(entry: dict[str, Any]) -> NDArray:
    """(4, 4) camera to world with OpenCV axes."""
    if "transform_matrix" not in entry:
        raise InputError("missing", where="transform_matrix")
    rows = entry["transform_matrix"]
    if isinstance(rows, list) and len(rows) == 3:
        rows = [*rows, [0, 0, 0, 1]]
    return finite_array("transform_matrix", rows, (4, 4)) @ OPENGL_TO_OPENCV


def _lens(fields: dict[str, Any], photo: Path) -> Lens:
    model = fields.get("camera_model", "OPENCV")
    fisheye = model == "OPENCV_FISHEYE" or fields.get("is_fisheye") is True
    if model not in (*_PERSPECTIVE, "OPENCV_FISHEYE"):
        fault = f"{str(model)[:40]}, expected one of {', '.join(_PERSPECTIVE)}, OPENCV_FISHEYE"
        raise InputError(fault, where="camera_model")
    size = _size(fields, photo)
    distortion = [_number(fields, name, 0.0) for name in ("k1", "k2", "k3", "k4", "p1", "p2")]
    centre = (_number(fields, "cx", size[1] / 2), _number(fields, "cy", size[0] / 2))
    return opencv_lens(_focal(fields, size), centre, distortion, size, fisheye=fisheye)


def _size(fields: dict[str, Any], photo: Path) -> tuple[int, int]:
    """(height, width), of the photo where the document states none."""
    if "w" not in fields or "h" not in fields:
        return image_size(photo)
    sides = [_number(fields, name, 0.0) for name in ("h", "w")]
    if any(side != int(side) for side in sides):
        raise InputError(f"{sides[1]:g}x{sides[0]:g}, expected whole numbers", where="w")
    return int(sides[0]), int(sides[1])


def _focal(fields: dict[str, Any], size: tuple[int, int]) -> tuple[float, float]:
    """(fx, fy) in pixels; one stands for the other, and angles of view for lengths."""
    height, width = size
    fx, fy = (
        _number(fields, length, _from_angle(fields, angle, side))
        for length, angle, side in (("fl_x", "camera_angle_x", width), ("fl_y", "camera_angle_y", height))
    )
    if not fx and not fy:
        raise InputError("missing, and so is camera_angle_x; one of them states the focal length", where="fl_x")
    return fx or fy, fy or fx


def _from_angle(fields: dict[str, Any], name: str, side: int) -> float:
    angle = _number(fields, name, 0.0)
    if not 0 <= angle < math.pi:
        raise InputError(f"{angle:g}, expected an angle of view between 0 and π", where=name)
    return side / 2 / math.tan(angle / 2) if angle else 0.0


def _number(fields: dict[str, Any], name: str, default: float) -> float:
    value = fields.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
        raise InputError(f"{str(value)[:20]} ({kind_of(value)}), expected a number", where=name)
    return float(value)


def _depths_of_points(
    folder: Path, document: dict[str, Any], cameras: list[Camera]
) -> tuple[float | None, float | None]:
    """The depth range of the scene's point cloud; (None, None) where there is none, or no package to read it."""
    if "ply_file_path" not in document:
        return None, None
    file = folder / photo_name(0, document, "ply_file_path")
    try:
        import plyfile
    except ImportError:
        return None, None
    if not file.is_file():
        return None, None
    with parsing("point cloud"):
        vertex = plyfile.PlyData.read(str(file))["vertex"]
        points = np.stack([vertex[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    return depth_range_in_view(points, cameras)
