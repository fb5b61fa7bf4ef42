"""The counts in a binary COLMAP model, held against the bytes that are there before pycolmap believes them, and the
names of its photos, whatever their encoding.

pycolmap appends as many elements as a count says, past the end of the file too: eight damaged bytes took it 20 seconds
and all memory. Layout: github.com/colmap/colmap, src/colmap/scene/reconstruction_io_binary.cc.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from ...errors import InputError

_COUNT = struct.Struct("<Q")
_CAMERA_BYTES = 24  # id, model, width, height; parameters follow
_POSE_BYTES = 4 + 7 * 8 + 4  # id, rotation and translation, camera
_OBSERVATION_BYTES = 24  # x, y, point
_POINT_BYTES = 8 + 3 * 8 + 3 + 8  # id, position, colour, error
_TRACK_ELEMENT_BYTES = 8  # image, observation


def check_counts(model: Path) -> None:
    """Look through the binary files of a model, where it has them.

    Raises:
        InputError: a file announces more than it holds; names the file.
    """
    for name, walk in _WALKS.items():
        file = model / name
        if not file.is_file():
            continue
        try:
            with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                walk(data)
        except (ValueError, struct.error):  # an empty file, or one that ends in a record
            raise InputError("damaged COLMAP model (announces more than it holds)", where=str(file)) from None


def photo_names(file: Path) -> dict[int, str]:
    """Names of the photos in an images.bin that `check_counts` passed, by their numbers."""
    with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return {number: decoded(name) for number, name in _photos(data)}


def decoded(name: bytes) -> str:
    """A name in UTF-8, else as Windows in the West wrote it."""
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace")


def _count(data: mmap.mmap, at: int, least_bytes: int) -> int:
    (count,) = _COUNT.unpack_from(data, at)
    _require(data, at + _COUNT.size, count * least_bytes)
    return int(count)


def _require(data: mmap.mmap, at: int, size: int) -> None:
    if size > len(data) - at:
        raise ValueError


def _walk_cameras(data: mmap.mmap) -> None:
    _count(data, 0, _CAMERA_BYTES)


def _walk_images(data: mmap.mmap) -> None:
    for _ in _photos(data):
        pass


def _photos(data: mmap.mmap) -> Iterator[tuple[int, bytes]]:
    """Number and name of each photo in images.bin."""
    at = _COUNT.size
    for _ in range(_count(data, 0, _POSE_BYTES)):
        end = data.find(b"\0", at + _POSE_BYTES)
        if end < 0:
            raise ValueError
        yield struct.unpack_from("<I", data, at)[0], data[at + _POSE_BYTES : end]
        at = end + 1
        at += _COUNT.size + _count(data, at, _OBSERVATION_BYTES) * _OBSERVATION_BYTES


def _walk_points(data: mmap.mmap) -> None:
    at = _COUNT.size
    for _ in range(_count(data, 0, _POINT_BYTES)):
        at += _POINT_BYTES
        at += _COUNT.size + _count(data, at, _TRACK_ELEMENT_BYTES) * _TRACK_ELEMENT_BYTES


_WALKS: dict[str, Callable[[mmap.mmap], None]] = {
    "cameras.bin": _walk_cameras,
    "images.bin": _walk_images,
    "points3D.bin": _walk_points,
}
