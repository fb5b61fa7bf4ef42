"""Scene folders with photos and `cameras.json`, of our own layout and of 3D Gaussian Splatting's reference code.

A scene folder holds images and `cameras.json`:

    {"near": 2.0, "far": 9.7, "frames": [{"file": "images/0000.jpg", "width": 455, "height": 256,
                                          "K": 3x3 in pixels of that image, "c2w": 4x4, OpenCV axes}, …]}

A photo that was made free of its lens's distortion may say in `taken_with` what it was taken with (`lens_entry`), so
that the frames of the video that photos come from can be used in their place. Keys that are not listed are ignored.

A list in place of the object is what the reference code writes beside a trained scene (Kerbl et al. 2023,
`utils/camera_utils.py`, `camera_to_JSON`):

    [{"id": 0, "img_name": "00001", "width": 1957, "height": 1091, "position": [3], "rotation": [3x3], "fx", "fy"}, …]

`position` is the camera's centre and `rotation` turns its axes, which are OpenCV's, to the world's; the principal point
is the middle. Photos are sought in `images/` and beside the file.

Trust boundary: the file is bounded in size, may not hold NaN, and names photos inside its own folder only.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from numpy.typing import NDArray

from ...errors import InputError, within
from ...system.files import read_limited
from ...system.jsonfields import JsonObject, parse_json
from ..cameras import Camera, intrinsics, posed
from ..lenses import Lens
from ..pictures import write_png
from ..scenes import MAX_CAMERAS_BYTES, Frame, Scene
from .fields import Fields
from .photos import find_photo, frames_there, is_there

CAMERAS_FILE = "cameras.json"


def load_folder(file: Path) -> Scene:
    """The scene of a `cameras.json`; InputError names the file and the field at fault."""
    folder = file.parent
    with within(str(file)):
        document = parse_json(read_limited(file, MAX_CAMERAS_BYTES))
        if isinstance(document, list):
            return Scene(folder, tuple(_inria_frames(folder, document)))
        fields = Fields(document)
        entries = fields.each("frames", 1)
        photos = [find_photo(folder, entry.photo("file")) for entry in entries]
        frames = [Frame(_camera(e), photo, taken_with=_taken_with(e)) for e, photo in zip(entries, photos, strict=True)]
        chosen = frames_there(photos, str(file), lambda i: frames[i])
        near, far = fields.depth("near"), fields.depth("far")
    return Scene(folder, tuple(chosen), near, far)


def cameras_alone(file: Path) -> list[Camera]:
    """The cameras of a `cameras.json`, whose frames need name no photo; errors of `load_folder`."""
    with within(str(file)):
        document = parse_json(read_limited(file, MAX_CAMERAS_BYTES))
        if isinstance(document, list):
            return _inria_cameras(document)
        return [_camera(entry) for entry in Fields(document).each("frames", 1)]


def write_photos(
    folder: Path, photos: Iterable[NDArray], cameras: Sequence[Camera], depths: tuple[float, float]
) -> None:
    """Write photos (H, W, 3) in [0, 1] as PNG into a folder, and `cameras.json` with near and far."""
    frames = []
    for number, (photo, camera) in enumerate(zip(photos, cameras, strict=True)):
        write_png(folder / f"{number}.png", photo)
        frames.append(camera_entry(f"{number}.png", camera))
    near, far = depths
    (folder / CAMERAS_FILE).write_text(json.dumps({"near": near, "far": far, "frames": frames}), "utf-8")


def camera_entry(file: str, camera: Camera) -> JsonObject:
    """A frame of `cameras.json`."""
    K, c2w = camera.K.tolist(), camera.c2w.tolist()
    return {"file": file, "width": camera.width, "height": camera.height, "K": K, "c2w": c2w}


def lens_entry(lens: Lens) -> JsonObject:
    """A frame's `taken_with` in `cameras.json`."""
    return {"model": lens.model, "params": list(lens.params), "width": lens.width, "height": lens.height}


def _taken_with(entry: Fields) -> Lens | None:
    if entry.values.get("taken_with") is None:
        return None
    given = entry.inside("taken_with")
    params = tuple(given.array("params", (-1,)).tolist())
    return Lens(str(given.value("model")), params, given.whole("width"), given.whole("height"))


def _camera(entry: Fields) -> Camera:
    K, c2w, width, height = entry.value("K"), entry.value("c2w"), entry.whole("width"), entry.whole("height")
    with within(entry.where, "."):
        return Camera(K, c2w, width, height)


def _inria_frames(folder: Path, entries: list[object]) -> list[Frame]:
    """The frames of a list of the reference code's, of a file in `folder`."""
    cameras = _inria_cameras(entries)
    names = [Fields(entry, f"[{i}]").photo("img_name") for i, entry in enumerate(entries)]
    beside = [folder if is_there(find_photo(folder, name)) else folder / "images" for name in names]
    photos = [find_photo(place, name) for place, name in zip(beside, names, strict=True)]
    return frames_there(photos, str(folder), lambda i: Frame(cameras[i], photos[i]))


def _inria_cameras(entries: list[object]) -> list[Camera]:
    """The cameras alone."""
    if not entries:
        raise InputError("an empty list, expected at least one camera")
    return [_listed(Fields(entry, f"[{i}]")) for i, entry in enumerate(entries)]


def _listed(entry: Fields) -> Camera:
    c2w = posed(entry.array("rotation", (3, 3)), entry.array("position", (3,)))
    fx, fy, width, height = (entry.number(name) for name in ("fx", "fy", "width", "height"))
    with within(entry.where, "."):
        return Camera(intrinsics(fx, fy, int(width) / 2, int(height) / 2), c2w, int(width), int(height))
