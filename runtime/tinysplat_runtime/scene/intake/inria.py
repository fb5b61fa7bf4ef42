"""`cameras.json` as the reference code of 3D Gaussian Splatting writes it beside a trained scene: a list of cameras.

    [{"id": 0, "img_name": "00001", "width": 1957, "height": 1091, "position": [3], "rotation": [3x3], "fx", "fy"}, …]

`position` is the camera's centre and `rotation` turns its axes, which are OpenCV's, to the world's; the principal point
is the middle. Photos are sought in `images/` and beside the file. Source: Kerbl et
al. 2023, `utils/camera_utils.py`, `camera_to_JSON`.
"""

from __future__ import annotations

from pathlib import Path

from ...errors import InputError, within
from ..cameras import Camera, intrinsics, posed
from ..scenes import Frame
from .fields import Fields
from .photos import find_photo, frames_there, is_there


def inria_frames(folder: Path, entries: list[object]) -> list[Frame]:
    """The frames of such a list, of a file in `folder`.

    Raises:
        InputError: names the entry and the field at fault.
    """
    cameras = inria_cameras(entries)
    names = [Fields(entry, f"[{i}]").photo("img_name") for i, entry in enumerate(entries)]
    beside = [folder if is_there(find_photo(folder, name)) else folder / "images" for name in names]
    photos = [find_photo(place, name) for place, name in zip(beside, names, strict=True)]
    return frames_there(photos, str(folder), lambda i: Frame(cameras[i], photos[i]))


def inria_cameras(entries: list[object]) -> list[Camera]:
    """The cameras alone; errors of `inria_frames`."""
    if not entries:
        raise InputError("an empty list, expected at least one camera")
    return [_camera(Fields(entry, f"[{i}]")) for i, entry in enumerate(entries)]


def _camera(entry: Fields) -> Camera:
    c2w = posed(entry.array("rotation", (3, 3)), entry.array("position", (3,)))
    fx, fy, width, height = (entry.number(name) for name in ("fx", "fy", "width", "height"))
    with within(entry.where, "."):
        return Camera(intrinsics(fx, fy, int(width) / 2, int(height) / 2), c2w, int(width), int(height))
