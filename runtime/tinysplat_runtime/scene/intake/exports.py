"""Folders that phone apps and OpenSfM export, read as if they were documents such as `transforms.json`.

- Polycam's raw data: `keyframes/corrected_cameras/*.json` beside `corrected_images/`, else `cameras/` beside `images/`.
  Each file has fx fy cx cy width height and t_00 to t_23, the upper rows of camera to world; OpenGL axes.
  Source: github.com/PolyCam/polyform.
- Record3D's frames: `metadata.json` with w, h, K by columns, and poses (qx qy qz qw x y z) of `rgb/0.jpg` and so on;
  OpenGL axes. Source: github.com/marek-simonik/record3d, docs.nerf.studio "Record3D".
- OpenSfM, and so OpenDroneMap: `reconstruction.json`, a list of which the largest is read. Shots turn the world into
  the camera (angle times axis, then a translation), OpenCV axes; lengths of a camera are in units of its longer side,
  from the middle. Source: opensfm.org/docs/geometry.html.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, warn, within
from ...system.files import read_limited
from ...system.jsonfields import JsonObject, kind_of, parse_json
from ..cameras import posed
from ..scenes import MAX_CAMERAS_BYTES, Scene
from .fields import Fields
from .nerfstudio import OPENGL_TO_OPENCV, frames_of
from .tracked import turned

POLYCAM, RECORD3D, OPENSFM = "keyframes", "metadata.json", "reconstruction.json"

Reader = Callable[[Path], Scene]
"""Takes the path of a scene."""

_MODELS = ("perspective", "simple_radial", "radial", "brown")


def export_reader(folder: Path) -> Reader | None:
    """What reads a folder of one of these tools; None for any other."""
    documents = {
        folder / POLYCAM / "corrected_cameras": _polycam,
        folder / POLYCAM / "cameras": _polycam,
        folder / RECORD3D: _record3d,
        folder / OPENSFM: _opensfm,
        folder / "opensfm" / OPENSFM: _opensfm,
    }
    return next((_reader(there, document) for there, document in documents.items() if there.exists()), None)


def _reader(there: Path, document: Callable[[Path], JsonObject]) -> Reader:
    def load(folder: Path) -> Scene:
        with within(str(there), known=str(folder)):
            return Scene(folder, frames_of(folder, document(there), str(there)))

    return load


def _polycam(cameras: Path) -> JsonObject:
    photos = f"{POLYCAM}/{cameras.name.replace('cameras', 'images')}"
    names = {"fl_x": "fx", "fl_y": "fy", "cx": "cx", "cy": "cy", "w": "width", "h": "height"}
    frames = []
    for file in sorted(file for file in cameras.glob("*.json") if not file.name.startswith(".")):
        with within(str(file)):
            entry = Fields(parse_json(read_limited(file, MAX_CAMERAS_BYTES)))
            frame: JsonObject = {short: entry.number(name) for short, name in names.items()}
            pose = [[entry.number(f"t_{row}{column}") for column in range(4)] for row in range(3)]
        frames.append({**frame, "transform_matrix": pose, "file_path": f"{photos}/{file.stem}"})
    return {"frames": frames}


def _record3d(file: Path) -> JsonObject:
    document = Fields(parse_json(read_limited(file, MAX_CAMERAS_BYTES)))
    K, poses = document.array("K", (9,)).reshape(3, 3).T, document.array("poses", (-1, 7))
    frames = []
    for i, (x, y, z, w, *centre) in enumerate(poses):
        pose = np.column_stack([_rotation(w, x, y, z, f"poses[{i}]"), centre])
        frames.append({"file_path": f"rgb/{i}", "transform_matrix": pose.tolist()})
    lens = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    size = {side: document.number(side) for side in "wh"}
    return {**{name: float(value) for name, value in lens.items()}, **size, "frames": frames}


def _opensfm(file: Path) -> JsonObject:
    reconstructions = parse_json(read_limited(file, MAX_CAMERAS_BYTES))
    if not isinstance(reconstructions, list) or not reconstructions:
        raise InputError(f"a JSON {kind_of(reconstructions)}, expected a list of one reconstruction or more")
    parts = [Fields(part, f"[{i}]") for i, part in enumerate(reconstructions)]
    shots = [part.inside("shots").values for part in parts]
    largest = max(range(len(parts)), key=lambda i: len(shots[i]))
    if len(parts) > 1:
        others = sum(map(len, shots)) - len(shots[largest])
        warn(f"{file}: {len(parts)} reconstructions; the largest is read, {others} photos of others are left out")
    cameras = parts[largest].inside("cameras").values
    lenses = {name: _opensfm_lens(Fields(camera, name)) for name, camera in cameras.items()}
    frames = []
    for name, entry in sorted(shots[largest].items()):
        shot = Fields(entry, name)
        if (camera := shot.values.get("camera")) not in lenses:
            raise InputError(f"{str(camera)[:60]}, which is none of the cameras", where=shot.place("camera"))
        frames.append({"file_path": f"images/{name}", **lenses[camera], "transform_matrix": _c2w(shot)})
    return {"frames": frames}


def _c2w(shot: Fields) -> list[list[float]]:
    """Camera to world with OpenGL axes, from a turn and a shift into the camera."""
    turn, shift = shot.array("rotation", (3,)), shot.array("translation", (3,))
    angle = float(np.linalg.norm(turn))
    sine = math.sin(angle / 2) / angle if angle else 0.5
    x, y, z = (sine * turn).tolist()
    into = _rotation(math.cos(angle / 2), x, y, z, shot.place("rotation"))
    return (posed(into.T, -into.T @ shift) @ OPENGL_TO_OPENCV).tolist()


def _opensfm_lens(camera: Fields) -> JsonObject:
    if (model := camera.values.get("projection_type")) not in _MODELS:
        fault = f"{str(model)[:40]}, expected one of {', '.join(_MODELS)}"
        raise InputError(fault, where=camera.place("projection_type"))
    width, height = camera.number("width"), camera.number("height")
    longer, focal = max(width, height), camera.values.get("focal")
    return {
        "fl_x": camera.number("focal_x", focal) * longer,
        "fl_y": camera.number("focal_y", focal) * longer,
        "w": width,
        "h": height,
        "cx": width / 2 + camera.number("c_x", 0.0) * longer,
        "cy": height / 2 + camera.number("c_y", 0.0) * longer,
        **{key: camera.number(key, 0.0) for key in ("k1", "k2", "k3", "p1", "p2")},
    }


def _rotation(w: float, x: float, y: float, z: float, where: str) -> NDArray:
    """(3, 3) of a quaternion, brought to length 1 from about that."""
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1) < 0.1:
        raise InputError(f"a quaternion of length {length:g}, expected 1", where=where)
    return turned(w / length, x / length, y / length, z / length)
