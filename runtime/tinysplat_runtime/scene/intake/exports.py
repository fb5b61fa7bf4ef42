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

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, warn, within
from ...system.files import read_limited
from ...system.jsonfields import JsonObject, kind_of, parse_json, parse_object
from ..cameras import finite_array
from ..scenes import MAX_CAMERAS_BYTES, Scene
from .nerfstudio import OPENGL_TO_OPENCV, frames_of

POLYCAM, RECORD3D, OPENSFM = "keyframes", "metadata.json", "reconstruction.json"

Reader = Callable[[Path, float | None, float | None], Scene]
"""Takes a path, near and far; the latter two replace the scene's own where they are not None."""

_MODELS = ("perspective", "simple_radial", "radial", "brown")


def export_reader(folder: Path) -> Reader | None:
    """What reads a folder of one of these tools, given near and far; None for any other."""
    documents = {
        folder / POLYCAM / "corrected_cameras": _polycam,
        folder / POLYCAM / "cameras": _polycam,
        folder / RECORD3D: _record3d,
        folder / OPENSFM: _opensfm,
        folder / "opensfm" / OPENSFM: _opensfm,
    }
    return next((_reader(there, document) for there, document in documents.items() if there.exists()), None)


def _reader(there: Path, document: Callable[[Path], JsonObject]) -> Reader:
    def load(folder: Path, near: float | None, far: float | None) -> Scene:
        with within(str(there), known=str(folder)):
            return Scene(folder, frames_of(folder, document(there), str(there)), near, far)

    return load


def _polycam(cameras: Path) -> JsonObject:
    photos = f"{POLYCAM}/{cameras.name.replace('cameras', 'images')}"
    frames = []
    for file in sorted(file for file in cameras.glob("*.json") if not file.name.startswith(".")):
        with within(str(file)):
            entry = parse_object(read_limited(file, MAX_CAMERAS_BYTES))
            names = {"fl_x": "fx", "fl_y": "fy", "cx": "cx", "cy": "cy", "w": "width", "h": "height"}
            frame: JsonObject = {short: _numbers(entry, name, ()).item() for short, name in names.items()}
            pose = [[_numbers(entry, f"t_{row}{column}", ()).item() for column in range(4)] for row in range(3)]
        frames.append({**frame, "transform_matrix": pose, "file_path": f"{photos}/{file.stem}"})
    return {"frames": frames}


def _record3d(file: Path) -> JsonObject:
    document = parse_object(read_limited(file, MAX_CAMERAS_BYTES))
    K, poses = _numbers(document, "K", (9,)).reshape(3, 3).T, _numbers(document, "poses", (-1, 7))
    frames = []
    for i, (x, y, z, w, *centre) in enumerate(poses):
        pose = np.column_stack([_rotation(w, x, y, z, f"poses[{i}]"), centre])
        frames.append({"file_path": f"rgb/{i}", "transform_matrix": pose.tolist()})
    lens = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    size = {side: _numbers(document, side, ()).item() for side in "wh"}
    return {**{name: float(value) for name, value in lens.items()}, **size, "frames": frames}


def _opensfm(file: Path) -> JsonObject:
    reconstructions = parse_json(read_limited(file, MAX_CAMERAS_BYTES))
    if not isinstance(reconstructions, list) or not reconstructions:
        raise InputError(f"a JSON {kind_of(reconstructions)}, expected a list of one reconstruction or more")
    parts = [_object(part, f"[{i}]") for i, part in enumerate(reconstructions)]
    shots = [_object(part.get("shots"), f"[{i}].shots") for i, part in enumerate(parts)]
    largest = max(range(len(parts)), key=lambda i: len(shots[i]))
    if len(parts) > 1:
        others = sum(map(len, shots)) - len(shots[largest])
        warn(f"{file}: {len(parts)} reconstructions; the largest is read, {others} photos of others are left out")
    cameras = _object(parts[largest].get("cameras"), f"[{largest}].cameras")
    lenses = {name: _opensfm_lens(_object(camera, name), name) for name, camera in cameras.items()}
    frames = []
    for name, shot in sorted(shots[largest].items()):
        shot = _object(shot, name)
        if shot.get("camera") not in lenses:
            raise InputError(f"{str(shot.get('camera'))[:60]}, which is none of the cameras", where=f"{name}.camera")
        frames.append({"file_path": f"images/{name}", **lenses[shot["camera"]], "transform_matrix": _c2w(shot, name)})
    return {"frames": frames}


def _c2w(shot: JsonObject, name: str) -> list[list[float]]:
    """Camera to world with OpenGL axes, from a turn and a shift into the camera."""
    turn, shift = (_numbers(shot, key, (3,), name) for key in ("rotation", "translation"))
    angle = float(np.linalg.norm(turn))
    sine = math.sin(angle / 2) / angle if angle else 0.5
    x, y, z = (sine * turn).tolist()
    into = _rotation(math.cos(angle / 2), x, y, z, f"{name}.rotation")
    pose = np.vstack([np.column_stack([into.T, -into.T @ shift]), [0, 0, 0, 1]])
    return (pose @ OPENGL_TO_OPENCV).tolist()


def _opensfm_lens(camera: JsonObject, name: str) -> JsonObject:
    if camera.get("projection_type") not in _MODELS:
        fault = f"{str(camera.get('projection_type'))[:40]}, expected one of {', '.join(_MODELS)}"
        raise InputError(fault, where=f"{name}.projection_type")
    values = {"c_x": 0.0, "c_y": 0.0, "k1": 0.0, "k2": 0.0, "k3": 0.0, "p1": 0.0, "p2": 0.0, **camera}
    if "focal" in camera:
        values = {"focal_x": camera["focal"], "focal_y": camera["focal"], **values}

    def number(key: str) -> float:
        return float(_numbers(values, key, (), name))

    width, height = number("width"), number("height")
    longer = max(width, height)
    return {
        "fl_x": number("focal_x") * longer,
        "fl_y": number("focal_y") * longer,
        "w": width,
        "h": height,
        "cx": width / 2 + number("c_x") * longer,
        "cy": height / 2 + number("c_y") * longer,
        **{key: number(key) for key in ("k1", "k2", "k3", "p1", "p2")},
    }


def _object(value: Any, where: str) -> JsonObject:
    if not isinstance(value, dict):
        raise InputError(f"a JSON {kind_of(value)}, expected an object", where=where)
    return value


def _numbers(fields: JsonObject, name: str, shape: tuple[int, ...], inside: str = "") -> NDArray:
    """Finite float64 numbers of a shape, as `finite_array` has it."""
    where = f"{inside}.{name}" if inside else name
    if name not in fields:
        raise InputError("missing", where=where)
    return finite_array(where, fields[name], shape)


def _rotation(w: float, x: float, y: float, z: float, where: str) -> NDArray:
    """(3, 3) of a quaternion, brought to length 1 from about that."""
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1) < 0.1:
        raise InputError(f"a quaternion of length {length:g}, expected 1", where=where)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) / length
    return np.eye(3) + 2 * (w / length * across + across @ across)
