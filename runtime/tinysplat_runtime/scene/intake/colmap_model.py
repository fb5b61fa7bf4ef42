"""COLMAP's models, binary and text: photos with their poses and cameras, points, and which photo observes which.

Layouts: github.com/colmap/colmap, src/colmap/scene/reconstruction_io_binary.cc and reconstruction_io_text.cc. Rigs and
frames are not read: they repeat the poses that photos have, and are often another model's. Points may be lacking.

Trust boundary: no count takes memory or time beyond the bytes that are there.
"""

import mmap
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .tracked import turned

CameraWords = tuple[str, tuple[float, ...], int, int]
"""Model, parameters, width and height: what a `Lens` is made of."""

_KINDS = (
    ("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8), ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12), ("FOV", 5), ("SIMPLE_RADIAL_FISHEYE", 4), ("RADIAL_FISHEYE", 5), ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16), ("SIMPLE_DIVISION", 4), ("DIVISION", 5), ("SIMPLE_FISHEYE", 3), ("FISHEYE", 4),
    ("EUCM", 6), ("EQUIRECTANGULAR", 2),
)  # fmt: skip
"""Camera models by their number, with how many parameters they have."""

_COUNT, _CAMERA, _PHOTO, _POINT = (struct.Struct(layout) for layout in ("<Q", "<IIQQ", "<I7dI", "<q3d3Bd"))
_OBSERVATION = np.dtype([("place", "<f8", 2), ("point", "<i8")])
_TRACK_ELEMENT_BYTES = 8  # photo, observation
_WORDS_BEFORE_NAME = 9  # number, rotation, translation, camera

Found = TypeVar("Found")
Record = tuple[list[float], int, bytes, NDArray]
"""Of a photo: rotation (wxyz) and translation, its camera's number, its name, and numbers of points (M,) int64."""


@dataclass(frozen=True)
class ModelPhoto:
    """A photo of a model.

    Attributes:
        name: as the model has it, with a folder before it now and then.
        w2c: (3, 4) float64.
        camera: that took it.
    """

    name: str
    w2c: NDArray
    camera: CameraWords


@dataclass(frozen=True, eq=False)
class Model:
    """A model.

    Attributes:
        photos: those that have a pose.
        points: (N, 3) float64, world.
        observations: (M, 2) int64, pairs of an index into `photos` and one into `points`.
    """

    photos: list[ModelPhoto]
    points: NDArray
    observations: NDArray


def read_model(folder: Path, suffix: str) -> Model:
    """The model in a folder, in files that end in `.bin` or `.txt`.

    Raises:
        InputError: a file that is cut short or holds what is no number, or two that do not go with each other.
    """
    cameras_of, photos_of, points_of = _TEXT if suffix == ".txt" else _BINARY
    cameras = dict(_records(folder / f"cameras{suffix}", cameras_of))
    for name, params, *_ in cameras.values():
        if len(params) != dict(_KINDS).get(name, len(params)):
            raise _damaged(folder, "cameras: parameters that are not those of the camera's model")
    records = _records(folder / f"images{suffix}", photos_of)
    file = folder / f"points3D{suffix}"
    points = dict(_records(file, points_of)) if file.is_file() else {}
    photos = [_photo(folder, record, cameras) for record in records]
    seen = [_rows(record[3], i, np.fromiter(points, np.int64)) for i, record in enumerate(records)]
    places = np.array([*points.values()], np.float64).reshape(-1, 3)
    return Model(photos, places, np.concatenate([np.empty((0, 2), np.int64), *seen]))


def _damaged(place: Path, fault: str) -> InputError:
    return InputError(f"damaged COLMAP model ({fault})", where=str(place))


def _records(file: Path, read: Callable[[BufferedReader], Iterable[Found]]) -> list[Found]:
    try:
        with file.open("rb") as stream:
            return list(read(stream))
    except (ValueError, struct.error, OverflowError, IndexError):  # an empty file, or one that ends within a record
        raise _damaged(file, "cut short, or holds what is no number") from None


def _photo(folder: Path, record: Record, cameras: dict[int, CameraWords]) -> ModelPhoto:
    (*quat, x, y, z), camera, name, _ = record
    if camera not in cameras:
        raise _damaged(folder, "images name a camera that is not among the cameras")
    length = float(np.linalg.norm(quat))
    if not 0 < length < np.inf or not np.isfinite((x, y, z)).all():
        raise _damaged(folder, "images: a pose that is none")
    rotation = turned(*(np.array(quat) / length).tolist())
    return ModelPhoto(_decoded(name), np.column_stack([rotation, (x, y, z)]), cameras[camera])


def _rows(seen: NDArray, photo: int, numbers: NDArray) -> NDArray:
    """(M, 2) observations of a photo that sees points of these numbers, of all numbers (N,)."""
    order = np.argsort(numbers)
    at = np.searchsorted(numbers, seen, sorter=order).clip(max=max(len(numbers) - 1, 0))
    rows = order[at][numbers[order[at]] == seen] if len(numbers) else order
    return np.column_stack([np.full(len(rows), photo), rows])


def _decoded(name: bytes) -> str:
    """A name in UTF-8, else as Windows in the West wrote it."""
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace")


# ---- binary ---------------------------------------------------------------------------------------------------------


def _mapped(file: BufferedReader) -> tuple[mmap.mmap, int]:
    """A file's bytes, and the count that they begin with."""
    data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    return data, _COUNT.unpack_from(data)[0]


def _cameras_of_bytes(file: BufferedReader) -> Iterator[tuple[int, CameraWords]]:
    (data, cameras), at = _mapped(file), _COUNT.size
    for _ in range(cameras):
        number, kind, width, height = _CAMERA.unpack_from(data, at)
        name, count = _KINDS[kind]
        yield number, (name, struct.unpack_from(f"<{count}d", data, at + _CAMERA.size), width, height)
        at += _CAMERA.size + 8 * count


def _photos_of_bytes(file: BufferedReader) -> Iterator[Record]:
    (data, photos), at = _mapped(file), _COUNT.size
    for _ in range(photos):
        _, *pose, camera = _PHOTO.unpack_from(data, at)
        end = data.find(b"\0", at + _PHOTO.size)
        if end < 0:
            raise ValueError
        (count,) = _COUNT.unpack_from(data, end + 1)
        at, name = end + 1 + _COUNT.size, data[at + _PHOTO.size : end]
        yield pose, camera, name, np.frombuffer(data, _OBSERVATION, count, at)["point"].copy()
        at += _OBSERVATION.itemsize * count


def _points_of_bytes(file: BufferedReader) -> Iterator[tuple[int, tuple[float, ...]]]:
    (data, points), at = _mapped(file), _COUNT.size
    for _ in range(points):
        number, *rest = _POINT.unpack_from(data, at)
        (count,) = _COUNT.unpack_from(data, at + _POINT.size)
        yield number, tuple(rest[:3])
        at += _POINT.size + _COUNT.size + _TRACK_ELEMENT_BYTES * count
        if at > len(data):
            raise ValueError


# ---- text -----------------------------------------------------------------------------------------------------------


def _words(lines: Iterable[bytes], most: int = -1) -> Iterator[list[bytes]]:
    """The words of lines that are neither empty nor comments."""
    for line in lines:
        if (words := line.split(maxsplit=most)) and not words[0].startswith(b"#"):
            yield words


def _cameras_of_text(lines: BufferedReader) -> Iterator[tuple[int, CameraWords]]:
    for number, name, width, height, *params in _words(lines):
        yield int(number), (name.decode(), tuple(map(float, params)), int(width), int(height))


def _photos_of_text(lines: BufferedReader) -> Iterator[Record]:
    for words in _words(lines, _WORDS_BEFORE_NAME):
        seen = np.array([int(word) for word in next(lines, b"").split()[2::3]], np.int64)
        yield [float(word) for word in words[1:8]], int(words[8]), words[9].strip(), seen


def _points_of_text(lines: BufferedReader) -> Iterator[tuple[int, tuple[float, ...]]]:
    for number, x, y, z, *_ in _words(lines, 4):
        yield int(np.int64(int(number))), (float(x), float(y), float(z))  # as binary models have it


_BINARY = _cameras_of_bytes, _photos_of_bytes, _points_of_bytes
_TEXT = _cameras_of_text, _photos_of_text, _points_of_text
