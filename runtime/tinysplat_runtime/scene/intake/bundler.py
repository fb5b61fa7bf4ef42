"""Cameras of Bundler's `.out`, which RealityCapture, RealityScan, Metashape and VisualSFM export, too.

    # Bundle file v0.3
    <cameras> <points>
    <f k1 k2>, three rows of R and t, for each camera; then position, colour and views, a line each, for each point

R and t lead into the camera, whose y points up and z backward; f is 0 of photos without a camera. Distortion is
1 + k1 r² + k2 r⁴, about the middle of the photo. Names are lines of `list.txt` or of a file called after the `.out`;
without one, photos are those beside it in the order of their names. Source: Snavely's "Bundler v0.4 User's Manual".

Trust boundary: the counts are held against the lines that are there.
"""

import re
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...system.files import read_limited
from ..cameras import posed
from ..lenses import Lens
from ..scenes import MAX_CAMERAS_BYTES
from .nerfstudio import OPENGL_TO_OPENCV
from .photos import find_folder, photos_in
from .tracked import FOLDERS, Track, Tracked, numbers

SIGN = rb"\A# Bundle file v0\.3"

_MAX_BYTES = 1 << 29
_LINES, _POINT_LINES = 5, 3  # of a camera, of a point
_MOST_POINTS = 100_000
_NUMBERS_BEHIND = re.compile(r"\s+\d+\s+[\d.eE+-]+\s*$")  # of a name: whether a fisheye, and its focal length


def read_bundler(file: Path) -> Track:
    """The cameras and points of such a file; InputError names the camera and its row."""
    lines = read_limited(file, _MAX_BYTES).splitlines()[1:]
    cameras, points = (int(count) for count in numbers("line 2", lines[0] if lines else b"", 2))
    if not 0 < cameras <= len(lines) // _LINES or not 0 <= points <= len(lines) // _POINT_LINES:
        raise InputError(f"{cameras} cameras and {points} points, more than it has lines for", where="line 2")
    names = _names(file, cameras)
    tracked = []
    for i in range(cameras):
        at = 1 + _LINES * i
        focal, k1, k2 = numbers(f"camera {i}, f k1 k2", lines[at], 3)
        if not focal > 0:
            continue
        w2c = np.stack([numbers(f"camera {i}, row {row}", lines[at + 1 + row], 3) for row in range(4)])
        rotation = w2c[:3].T
        c2w = posed(rotation, -rotation @ w2c[3]) @ OPENGL_TO_OPENCV
        tracked.append(Tracked(names[i], c2w, partial(_lens, focal, k1, k2)))
    first = 1 + _LINES * cameras
    step = max(1, points // _MOST_POINTS)
    rows = lines[first : first + _POINT_LINES * points : _POINT_LINES * step]
    return Track(tracked, np.array([numbers("points", row, 3) for row in rows]).reshape(-1, 3))


def _names(file: Path, count: int) -> list[str]:
    """Names of the photos of so many cameras."""
    beside = [file.with_suffix(end) for end in (".list.txt", ".lst", ".txt")]
    lists = [*beside, file.parent / "list.txt", file.parent.parent / "list.txt"]
    listed = next((path for path in lists if path.is_file()), None)
    if listed is None:
        places = (find_folder(base, name) for base in (file.parent, file.parent.parent) for name in FOLDERS)
        photos = next((found for place in places if place and len(found := photos_in(place)) == count), None)
        if photos is None:
            raise InputError(f"no list.txt beside it, nor {count} photos that its cameras might be of")
        return [photo.name for photo in photos]
    text = read_limited(listed, MAX_CAMERAS_BYTES).decode("utf-8", "replace")
    names = [_NUMBERS_BEHIND.sub("", line).strip() for line in text.splitlines() if line.strip()]
    if len(names) != count:
        raise InputError(f"{len(names)} names for {count} cameras", where=listed.name)
    return names


def _lens(focal: float, k1: float, k2: float, size: tuple[int, int]) -> Lens:
    height, width = size
    if not k1 and not k2:
        return Lens("SIMPLE_PINHOLE", (float(focal), width / 2, height / 2), width, height)
    return Lens("RADIAL", (float(focal), width / 2, height / 2, float(k1), float(k2)), width, height)
