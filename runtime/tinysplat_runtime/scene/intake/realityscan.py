"""Cameras that RealityScan and RealityCapture export as `.csv` ("Internal/External camera parameters").

A header, then a row for each photo: `#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2`. z points up;
without turns a camera looks down, its top to y; heading turns clockwise about z after pitch about x after roll about
y, in degrees. f is of a picture 36 wide along its longer side, px and py are shares of that side from the middle.
Distortion is Brown's: k1 to k4 by r², r⁴, r⁶ and r⁸, and t for OpenCV's p. Source: RealityScan Help, "Registration
export", and Epic's "Camera Geometry in RealityScan".
"""

import csv
import io
import re
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...system.files import read_limited
from ..cameras import posed
from ..lenses import Lens, brown_lens
from ..scenes import MAX_CAMERAS_BYTES
from .nerfstudio import OPENGL_TO_OPENCV
from .tracked import Track, Tracked, number

SIGN = rb"(?i)\A(\xef\xbb\xbf)?(#cameras[^\n]*\n)?#?\s*name\s*,[^\r\n]*\bheading\b"

_NEEDED = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
_COUNT = re.compile(r"\A#cameras.*\n", re.IGNORECASE)  # before the header of some
_FILM = 36.0  # of the longer side, to which f refers


def read_realityscan(file: Path) -> Track:
    """The cameras of such a file; InputError names the photo and its column."""
    text = read_limited(file, MAX_CAMERAS_BYTES).decode("utf-8-sig", "replace")
    rows = csv.reader(io.StringIO(_COUNT.sub("", text).removeprefix("#"), newline=""))
    try:
        header = [name.strip().lower() for name in next(rows)]
        if missing := [name for name in _NEEDED if name not in header]:
            raise InputError(f"lacks {', '.join(missing)}", where="header")
        entries = [dict(zip(header, row, strict=False)) for row in rows if any(row)]
    except (csv.Error, StopIteration):
        raise InputError("no table of comma-separated values") from None
    return Track([_camera(entry) for entry in entries])


def _camera(entry: dict[str, str]) -> Tracked:
    name = entry["name"].strip()
    values = {key: number(f"{name[:60]}.{key}", word.strip() or 0) for key, word in entry.items() if key in _NUMBERS}
    if lacking := [key for key in _NEEDED if key not in {"name", *values}]:
        raise InputError("missing", where=f"{name[:60]}.{lacking[0]}")
    heading, pitch, roll = (np.radians(values[key]) for key in ("heading", "pitch", "roll"))
    turn = _about(2, -heading) @ _about(0, pitch) @ _about(1, roll)
    c2w = posed(turn, np.array([values["x"], values["y"], values["alt"]])) @ OPENGL_TO_OPENCV
    return Tracked(name, c2w, partial(_lens, values))


def _about(axis: int, angle: float) -> np.ndarray:
    """(3, 3) of a turn about an axis of the world."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[one, one] = turn[other, other] = np.cos(angle)
    turn[other, one], turn[one, other] = np.sin(angle), -np.sin(angle)
    return turn


_TERMS = (("k", 4), ("t", 2))
_NUMBERS = {*_NEEDED[1:], "px", "py", "k1", "k2", "k3", "k4", "t1", "t2"}


def _lens(values: dict[str, float], size: tuple[int, int]) -> Lens:
    height, width = size
    longer = max(size)
    focal = values["f"] * longer / _FILM
    centre = (width / 2 + values.get("px", 0.0) * longer, height / 2 + values.get("py", 0.0) * longer)
    radial, tangential = ([values.get(f"{letter}{n}", 0.0) for n in range(1, count + 1)] for letter, count in _TERMS)
    return brown_lens((focal, focal), centre, radial, tangential, size)
