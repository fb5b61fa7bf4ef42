"""`cameras.json` as the reference code of 3D Gaussian Splatting writes it beside a trained scene: a list of cameras.

    [{"id": 0, "img_name": "00001", "width": 1957, "height": 1091, "position": [3], "rotation": [3x3], "fx", "fy"}, …]

`position` is the camera's centre and `rotation` turns its axes, which are OpenCV's, to the world's; the principal point
is the middle. Photos are sought in `images/` and beside the file. Source: Kerbl et
al. 2023, `utils/camera_utils.py`, `camera_to_JSON`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, within
from ...system.jsonfields import kind_of, photo_name
from ..cameras import Camera, finite_array
from ..lenses import intrinsics
from ..scenes import Frame
from .photos import find_photo, is_there, present


def inria_frames(folder: Path, entries: list[Any]) -> list[Frame]:
    """The frames of such a list, of a file in `folder`.

    Raises:
        InputError: names the entry and the field at fault.
    """
    cameras = inria_cameras(entries)
    names = [photo_name(i, entry, "img_name") for i, entry in enumerate(entries)]
    beside = [folder if is_there(find_photo(folder, name)) else folder / "images" for name in names]
    photos = [find_photo(place, name) for place, name in zip(beside, names, strict=True)]
    return [Frame(cameras[i], photos[i]) for i in present(photos, str(folder))]


def inria_cameras(entries: list[Any]) -> list[Camera]:
    """The cameras alone; errors of `inria_frames`."""
    if not entries:
        raise InputError("an empty list, expected at least one camera")
    return [_camera(f"[{i}]", entry) for i, entry in enumerate(entries)]


def _camera(where: str, entry: Any) -> Camera:
    if not isinstance(entry, dict):
        raise InputError(f"a JSON {kind_of(entry)}, expected an object", where=where)
    for name in ("position", "rotation", "width", "height", "fx", "fy"):
        if name not in entry:
            raise InputError("missing", where=f"{where}.{name}")
    c2w = np.eye(4)
    for name, shape, place in (("rotation", (3, 3), np.s_[:3, :3]), ("position", (3,), np.s_[:3, 3])):
        c2w[place] = finite_array(f"{where}.{name}", entry[name], shape)
    for name in ("width", "height", "fx", "fy"):
        value = entry[name]
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{str(value)[:40]} (a JSON {kind_of(value)}), expected a number", where=f"{where}.{name}")
    width, height = int(entry["width"]), int(entry["height"])
    with within(where, "."):
        return Camera(intrinsics(entry["fx"], entry["fy"], width / 2, height / 2), c2w, width, height)
