"""`transforms.json`, as NeRF (there `transforms_train.json`), instant-ngp and nerfstudio write it.

Poses are camera to world with OpenGL axes (x right, y up, z backward). Intrinsics stand at the top or in a frame, which
wins: `fl_x fl_y cx cy w h`, or the angle of view `camera_angle_x`; distortion `k1 … k6 p1 p2` is OpenCV's, a fisheye's
where `camera_model` or `is_fisheye` says so; `mask_path` names a frame's mask. The depth range is that of the points in
`ply_file_path`, in the coordinates of the poses; without points that can be read it is found later. Source:
docs.nerf.studio, "Data conventions"; instant-ngp, docs/nerf_dataset_tips.md.
"""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, warn, within
from ...system.files import parsing, read_limited
from ...system.jsonfields import JsonObject, parse_object
from ...system.ply import ply_elements
from ..cameras import Camera, finite_array
from ..images import image_size
from ..lenses import Lens, opencv_lens
from ..masks import Mask
from ..scenes import MAX_CAMERAS_BYTES, Frame, Scene, even_sizes
from .depths import depth_range_in_view
from .fields import Fields
from .photos import find_photo, frames_there, lens_of_copy

FILE = "transforms.json"
BLENDER_FILE = "transforms_train.json"  # the synthetic scenes of NeRF have one for each use

OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Right factor of a camera-to-world matrix that turns its camera axes."""

_PERSPECTIVE = ("OPENCV", "FULL_OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_FISHEYES = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
_DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_MAX_POINTS_BYTES = 4 << 30


def load_transforms(path: Path) -> Scene:
    """Read a folder with a `transforms.json`, or such a file; InputError names the file and the field at fault."""
    file = path / (FILE if (path / FILE).exists() else BLENDER_FILE) if path.is_dir() else path
    with within(str(file), known=str(file.parent)):
        document = parse_object(read_limited(file, MAX_CAMERAS_BYTES))
        frames = frames_of(file.parent, document, str(file))
        near, far = (Fields(document).depth(name) for name in ("near", "far"))
        if near is None or far is None:
            depths = _depths_of_points(file.parent, document, [frame.camera for frame in frames])
            near, far = near or depths[0], far or depths[1]
    return Scene(file.parent, frames, near, far)


def frames_of(folder: Path, document: JsonObject, named: str) -> tuple[Frame, ...]:
    """The frames of a document whose photos are in a folder; all of them where none is, as beside a video.

    Raises:
        InputError: names the frame and its field.
    """
    entries = Fields(document).each("frames", 1)
    photos = [find_photo(folder, entry.photo("file_path")) for entry in entries]
    return even_sizes(frames_there(photos, named, lambda i: _frame(folder, document, entries[i], photos[i])))


def _frame(folder: Path, document: JsonObject, entry: Fields, photo: Path) -> Frame:
    mask = None  # a picture that says which of the photo's pixels count
    if entry.values.get("mask_path") is not None:
        mask = Mask(find_photo(folder, entry.photo("mask_path")), is_background=False)
    pose = _pose(entry)
    with within(entry.where, ".", known=str(folder)):
        lens = lens_of_copy(_lens(Fields({**document, **entry.values}), photo), photo)
        return Frame.through(lens, pose, photo, mask)


def _pose(entry: Fields) -> NDArray:
    """(4, 4) camera to world with OpenCV axes."""
    rows = entry.value("transform_matrix")
    if isinstance(rows, list) and len(rows) == 3:
        rows = [*rows, [0, 0, 0, 1]]
    return finite_array(entry.place("transform_matrix"), rows, (4, 4)) @ OPENGL_TO_OPENCV


def _lens(fields: Fields, photo: Path) -> Lens:
    model = fields.value("camera_model", "OPENCV")
    fisheye = model in _FISHEYES or fields.values.get("is_fisheye") is True
    if model not in (*_PERSPECTIVE, *_FISHEYES):
        fault = f"{str(model)[:40]}, expected one of {', '.join((*_PERSPECTIVE, *_FISHEYES))}"
        raise InputError(fault, where="camera_model")
    size = _size(fields, photo)
    distortion = [fields.number(name, 0.0) for name in _DISTORTION]
    centre = (fields.number("cx", size[1] / 2), fields.number("cy", size[0] / 2))
    return opencv_lens(_focal(fields, size), centre, distortion, size, fisheye=fisheye)


def _size(fields: Fields, photo: Path) -> tuple[int, int]:
    """(height, width), of the photo where the document states none."""
    if not {"w", "h"} <= fields.values.keys():
        return image_size(photo)
    height, width = fields.number("h"), fields.number("w")
    if height % 1 or width % 1:
        raise InputError(f"{width:g}x{height:g}, expected whole numbers", where="w")
    return int(height), int(width)


def _focal(fields: Fields, size: tuple[int, int]) -> tuple[float, float]:
    """(fx, fy) in pixels; one stands for the other, and angles of view for lengths."""
    height, width = size
    fx, fy = (
        fields.number(length, _from_angle(fields, angle, side))
        for length, angle, side in (("fl_x", "camera_angle_x", width), ("fl_y", "camera_angle_y", height))
    )
    if not fx and not fy:
        raise InputError("missing, and so is camera_angle_x; one of them states the focal length", where="fl_x")
    return fx or fy, fy or fx


def _from_angle(fields: Fields, name: str, side: int) -> float:
    angle = fields.number(name, 0.0)
    if not 0 <= angle < math.pi:
        raise InputError(f"{angle:g}, expected an angle of view between 0 and π", where=name)
    return side / 2 / math.tan(angle / 2) if angle else 0.0


def _depths_of_points(folder: Path, document: JsonObject, cameras: list[Camera]) -> tuple[float | None, float | None]:
    """The depth range of the scene's point cloud; (None, None) where there is none, or none that can be read: a scene
    goes on without its points, and says so.
    """
    named = document.get("ply_file_path")
    if named is None:
        return None, None
    try:
        file = find_photo(folder, Fields(document).photo("ply_file_path"))
        if not file.is_file():
            raise InputError("no such file")
        vertex = ply_elements(file, _MAX_POINTS_BYTES).get("vertex")
        with parsing("point cloud"):
            points = np.stack([vertex[axis] for axis in "xyz"], axis=-1).astype(np.float64)  # type: ignore[index]
    except ImportError:
        return None, None
    except InputError as error:
        warn(f"{folder}: points of {str(named)[:60]} are left out ({error.message}); depths are found from the photos")
        return None, None
    return depth_range_in_view(points, cameras)
