"""The counts in a binary COLMAP model, held against the bytes that are there before pycolmap believes them.

pycolmap appends as many elements as a count says, past the end of the file too: eight damaged bytes took it 20 seconds
and all memory. Layout: github.com/colmap/colmap, src/colmap/scene/reconstruction_io_binary.cc.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable
from pathlib import Path

from ...errors import InputError

_COUNT = struct.Struct("<Q")
_CAMERA_BYTES = 24  # id, model, width, height; parameters follow
_POSE_BYTES = 4 + 7 * 8 + 4  # id, rotation and translation, camera
_OBSERVATION_BYTES = 24  # x, y, point
_POINT_BYTES = 8 + 3 * 8 + 3 + 8  # id, position, colour, error
_TRACK_ELEMENT_BYTES = 8  # image, observation
_RIG = struct.Struct("<II")  # id, sensors; then the reference sensor and the others
_SENSOR_BYTES = 8  # kind, id; the others' are followed by whether there is a pose, and the pose
_SENSOR_POSE_BYTES = 7 * 8
_FRAME = struct.Struct("<II56xI")  # id, rig, rotation and translation, pictures
_PICTURE_BYTES = 16  # kind, sensor, id


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
    at = _COUNT.size
    for _ in range(_count(data, 0, _POSE_BYTES)):
        end = data.find(b"\0", at + _POSE_BYTES)
        if end < 0:
            raise ValueError
        at = end + 1
        at += _COUNT.size + _count(data, at, _OBSERVATION_BYTES) * _OBSERVATION_BYTES


def _walk_points(data: mmap.mmap) -> None:
    at = _COUNT.size
    for _ in range(_count(data, 0, _POINT_BYTES)):
        at += _POINT_BYTES
        at += _COUNT.size + _count(data, at, _TRACK_ELEMENT_BYTES) * _TRACK_ELEMENT_BYTES


def _walk_rigs(data: mmap.mmap) -> None:
    at = _COUNT.size
    for _ in range(_count(data, 0, _RIG.size)):
        _, sensors = _RIG.unpack_from(data, at)
        at += _RIG.size
        _require(data, at, sensors * _SENSOR_BYTES)
        at += _SENSOR_BYTES * bool(sensors)
        for _ in range(1, sensors):
            has_pose = struct.unpack_from("<8x?", data, at)[0]
            at += _SENSOR_BYTES + 1 + _SENSOR_POSE_BYTES * has_pose


def _walk_frames(data: mmap.mmap) -> None:
    at = _COUNT.size
    for _ in range(_count(data, 0, _FRAME.size)):
        *_, pictures = _FRAME.unpack_from(data, at)
        at += _FRAME.size
        _require(data, at, pictures * _PICTURE_BYTES)
        at += pictures * _PICTURE_BYTES


_WALKS: dict[str, Callable[[mmap.mmap], None]] = {
    "cameras.bin": _walk_cameras,
    "images.bin": _walk_images,
    "points3D.bin": _walk_points,
    "rigs.bin": _walk_rigs,
    "frames.bin": _walk_frames,
}
