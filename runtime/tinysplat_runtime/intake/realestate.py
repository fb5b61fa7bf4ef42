"""RealEstate10K's camera files: a video's address, then a line per frame.

A line is the frame's time stamp in microseconds, fx, fy, cx, cy divided by the picture's width and height, two unused
values, and the 3×4 world-to-camera matrix row by row, OpenCV axes. Photos are called after their time stamps and lie
in a folder of the file's own name, in `images/`, or beside it. Source: google.github.io/realestate10k.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tinysplat_runtime.cameras import Camera
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.files import read_limited
from tinysplat_runtime.images import image_size
from tinysplat_runtime.scenes import MAX_CAMERAS_BYTES, Frame, Scene

from .lenses import intrinsics

VALUES = 19
_SUFFIXES = (".jpg", ".png", ".jpeg")


def load_realestate(file: Path, near: float | None, far: float | None) -> Scene:
    """Read a camera file; frames whose photo is not there are left out.

    Raises:
        InputError: names the line at fault, or says where photos were looked for.
    """
    try:
        lines = read_limited(file, MAX_CAMERAS_BYTES).decode("utf-8").splitlines()
    except UnicodeDecodeError:
        raise InputError("not text, expected a RealEstate10K camera file", where=str(file)) from None
    folders = [file.with_suffix(""), file.parent / "images", file.parent]
    frames = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        stamp, row = _values(line, f"{file}: line {number}")
        photo = _photo(folders, stamp)
        if photo is not None:
            try:
                frames.append(Frame(_camera(row, image_size(photo)), photo))
            except InputError as error:
                raise InputError(error.message, where=f"{file}: line {number}") from None
    if not frames:
        looked = ", ".join(str(folder) for folder in folders)
        raise InputError(f"no photo called after a time stamp in {looked}", where=str(file))
    return Scene(file, tuple(frames), near, far)


def _values(line: str, where: str) -> tuple[str, list[float]]:
    """A line's time stamp and its 18 numbers."""
    words = line.split()
    try:
        row = [float(word) for word in words[1:]]
    except ValueError:
        row = []
    if len(row) != VALUES - 1 or not words[0].isdigit():
        raise InputError(f"'{line[:40]}', expected a time stamp and {VALUES - 1} numbers", where=where)
    return words[0], row


def _photo(folders: list[Path], stamp: str) -> Path | None:
    names = [folder / f"{stamp}{suffix}" for folder in folders for suffix in _SUFFIXES]
    return next((name for name in names if name.is_file()), None)


def _camera(row: list[float], size: tuple[int, int]) -> Camera:
    height, width = size
    fx, fy, cx, cy = row[:4]
    w2c = np.vstack([np.reshape(row[6:], (3, 4)), [0, 0, 0, 1]])
    if not np.isfinite(w2c).all() or not abs(np.linalg.det(w2c)) > 0:
        raise InputError("the pose is no rigid motion")
    K = intrinsics(fx * width, fy * height, cx * width, cy * height)
    return Camera(K, np.linalg.inv(w2c), width, height)
