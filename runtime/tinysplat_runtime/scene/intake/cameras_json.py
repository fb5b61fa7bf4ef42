"""Scene folders of our own layout: photos and the cameras that took them.

A scene folder holds images and `cameras.json`:

    {"near": 2.0, "far": 9.7, "frames": [{"file": "images/0000.jpg", "width": 455, "height": 256,
                                          "K": 3x3 in pixels of that image, "c2w": 4x4, OpenCV axes}, …]}

A photo that was made free of its lens's distortion may say in `taken_with` what it was taken with (`lens_entry`), so
that the frames of the video that photos come from can be used in their place. Keys that are not listed are ignored.

A list in place of the object is another tool's, and read as `inria` says.

Trust boundary: the file is bounded in size, may not hold NaN, and names photos inside its own folder only.
"""

from __future__ import annotations

import json
from pathlib import Path

from ...errors import InputError, within
from ...system.files import read_limited
from ...system.jsonfields import JsonObject, as_object, depth, frame_entries, kind_of, parse_json, photo_name
from ..cameras import Camera
from ..lenses import Lens
from ..scenes import MAX_CAMERAS_BYTES, Frame, Scene
from .inria import inria_cameras, inria_frames
from .photos import find_photo, present

CAMERAS_FILE = "cameras.json"


def load_folder(file: Path, near: float | None, far: float | None) -> Scene:
    """The scene of a `cameras.json`; near and far replace the file's own.

    Raises:
        InputError: names the file and the field at fault.
    """
    with within(str(file)):
        document = parse_json(read_limited(file, MAX_CAMERAS_BYTES))
        if isinstance(document, list):
            return Scene(file.parent, tuple(inria_frames(file.parent, document)), near, far)
        entries = frame_entries(as_object(document))
        photos = [find_photo(file.parent, photo_name(i, entry)) for i, entry in enumerate(entries)]
        frames = [Frame(_camera(i, e), photos[i], taken_with=_taken_with(i, e)) for i, e in enumerate(entries)]
        frames = [frames[i] for i in present(photos, str(file))]
        near = depth(document, "near") if near is None else near
        far = depth(document, "far") if far is None else far
    return Scene(file.parent, tuple(frames), near, far)


def cameras_alone(file: Path) -> list[Camera]:
    """The cameras of a `cameras.json`, whose frames need name no photo; errors of `load_folder`."""
    with within(str(file)):
        document = parse_json(read_limited(file, MAX_CAMERAS_BYTES))
        if isinstance(document, list):
            return inria_cameras(document)
        return [_camera(i, entry) for i, entry in enumerate(frame_entries(as_object(document)))]


def camera_entry(file: str, camera: Camera) -> JsonObject:
    """A frame of `cameras.json`."""
    K, c2w = camera.K.tolist(), camera.c2w.tolist()
    return {"file": file, "width": camera.width, "height": camera.height, "K": K, "c2w": c2w}


def lens_entry(lens: Lens) -> JsonObject:
    """A frame's `taken_with` in `cameras.json`."""
    return {"model": lens.model, "params": list(lens.params), "width": lens.width, "height": lens.height}


def _taken_with(i: int, entry: JsonObject) -> Lens | None:
    given = entry.get("taken_with")
    if given is None:
        return None
    try:
        params = tuple(float(value) for value in given["params"])
        return Lens(str(given["model"]), params, given["width"], given["height"])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError("expected model, params, width and height", where=f"frames[{i}].taken_with") from None


def _camera(i: int, entry: JsonObject) -> Camera:
    for name in ("K", "c2w", "width", "height"):
        if name not in entry:
            raise InputError("missing", where=f"frames[{i}].{name}")
    for name in ("width", "height"):
        if type(entry[name]) is not int:
            fault = f"{json.dumps(entry[name])[:40]} (a JSON {kind_of(entry[name])})"
            raise InputError(f"{fault}, expected a whole number", where=f"frames[{i}].{name}")
    with within(f"frames[{i}]", "."):
        return Camera(K=entry["K"], c2w=entry["c2w"], width=entry["width"], height=entry["height"])
