"""RealEstate10K's camera files: a video's address, then a line per frame.

A line is the frame's time stamp in microseconds, fx, fy, cx, cy divided by the picture's width and height, two unused
values, and the 3×4 world-to-camera matrix row by row, OpenCV axes. Photos are called after their time stamps and lie
in a folder of the file's own name, in `images/`, or beside it; without any, a video of the file's own name beside it
has the frames. Source: google.github.io/realestate10k.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, within
from ...system.files import read_limited
from ..cameras import Camera, intrinsics
from ..footage import SUFFIXES as VIDEO_SUFFIXES
from ..footage import open_video
from ..images import image_size
from ..scenes import MAX_CAMERAS_BYTES, Frame, Scene
from .photos import find_photo

VALUES = 19
MICROSECONDS = 1_000_000  # time stamps of a second


def load_realestate(file: Path, video: Path | None = None) -> Scene:
    """Read a camera file and find its photos; frames whose photo is not there are left out.

    Args:
        file: the camera file.
        video: has all the frames, in place of photos.

    Raises:
        InputError: names the line at fault, or says where photos were looked for.
    """
    rows = _rows(file)
    folders = [file.with_suffix(""), file.parent / "images", file.parent]
    photos = {} if video else {line: _photo(folders, stamp) for line, (stamp, _) in rows.items()}
    if not any(photos.values()):
        video = video or next((v for suffix in VIDEO_SUFFIXES if (v := file.with_suffix(suffix)).is_file()), None)
    clip = None if video is None else open_video(video)
    frames = []
    for line, (stamp, row) in rows.items():
        photo = photos.get(line)
        with within(f"{file}: line {line}"):
            if clip is not None:
                index = clip.index_at(int(stamp) / MICROSECONDS)
                camera = _camera(row, (clip.height, clip.width))
                frames.append(Frame(camera, clip.path, video=clip, index=index))
            elif photo is not None:
                frames.append(Frame(_camera(row, image_size(photo)), photo))
    if not frames:
        looked = ", ".join(str(folder) for folder in folders)
        raise InputError(f"no photo called after a time stamp in {looked}, and no video beside it", where=str(file))
    return Scene(file, tuple(frames))


def _rows(file: Path) -> dict[int, tuple[str, list[float]]]:
    """A frame's time stamp and numbers by the line that they stand in."""
    try:
        lines = read_limited(file, MAX_CAMERAS_BYTES).decode("utf-8").splitlines()
    except UnicodeDecodeError:
        raise InputError("not text, expected a RealEstate10K camera file", where=str(file)) from None
    numbered = enumerate(lines[1:], start=2)
    return {number: _values(line, f"{file}: line {number}") for number, line in numbered if line.strip()}


def _values(line: str, where: str) -> tuple[str, list[float]]:
    """A line's time stamp and its 18 numbers."""
    words = line.split()
    try:
        row = [float(word) for word in words[1:]]
    except ValueError:
        row = []
    if len(row) != VALUES - 1 or not words[0].isdecimal() or len(words[0]) > 15:
        raise InputError(f"'{line[:40]}', expected a time stamp and {VALUES - 1} numbers", where=where)
    return words[0], row


def _photo(folders: list[Path], stamp: str) -> Path | None:
    return next((photo for folder in folders if (photo := find_photo(folder, stamp)).is_file()), None)


def pose_of(row: Sequence[float] | NDArray) -> NDArray:
    """(4, 4) camera to world of a line's 18 numbers."""
    w2c = np.vstack([np.reshape(row[6:], (3, 4)), [0, 0, 0, 1]])
    if not np.isfinite(w2c).all() or not abs(np.linalg.det(w2c)) > 0:
        raise InputError("the pose is no rigid motion")
    return np.linalg.inv(w2c)


def _camera(row: list[float], size: tuple[int, int]) -> Camera:
    height, width = size
    fx, fy, cx, cy = row[:4]
    try:
        return Camera(intrinsics(fx * width, fy * height, cx * width, cy * height), pose_of(row), width, height)
    except InputError as error:
        raise InputError(error.message) from None  # the file has no names for fields
