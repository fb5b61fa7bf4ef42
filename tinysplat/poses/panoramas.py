"""360° pictures as six photos of a cube's faces each, of which one place is sought: a rig of cameras.

An equirectangular picture has longitudes along its rows, ahead in the middle and to the right from there, and
latitudes along its columns. Its axes are those of a camera that looks ahead: x right, y down, z ahead. Files say what
they are by XMP (Google's "Photo Sphere XMP", `GPano:ProjectionType`), videos by a box `sv3d` with `equi` in it or the
older `uuid` with the same as XML (github.com/google/spatial-media, "Spherical Video").
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render.panorama import FACES

_HEAD_BYTES = 1 << 20
"""Of a photo, that its XMP is sought in."""

_MOVIE_BYTES = 64 << 20
"""Largest description of a video that is looked through."""

_AREA = re.compile(rb"GPano:(FullPano|CroppedAreaImage)(Width|Height)Pixels(?:=[\"']|>)\s*(\d{1,6})")
_XMP = re.compile(rb"ProjectionType(?:=[\"']|>)equirectangular")
_UUID = bytes.fromhex("ffcc82 63f855 4a93 8814 587a 02521fdd")


@dataclass(frozen=True)
class Wedge:
    """Longitudes between two, degrees from ahead to the right, which are left out in every picture."""

    first: float
    last: float

    def holds(self, directions: NDArray) -> NDArray:
        """Which of (…, 3) lie in it."""
        longitude = np.degrees(np.arctan2(directions[..., 0], directions[..., 2]))
        held: NDArray = (longitude - self.first) % 360 <= (self.last - self.first) % 360
        return held


def rays(side: int) -> NDArray:
    """(side, side, 3) float64 directions of a face's pixels in its camera's axes, of length 1 along z."""
    row, column = (np.mgrid[:side, :side] + 0.5) * (2 / side) - 1
    return np.stack([column, row, np.ones_like(row)], axis=-1)


def places(directions: NDArray, height: int) -> NDArray:
    """(…, 2) pixels, x first, of directions (…, 3) in an equirectangular picture (height, 2·height)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    longitude, latitude = np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
    return np.stack([(longitude / np.pi + 1) * height, (0.5 - latitude / np.pi) * height], axis=-1)


def face(picture: NDArray, name: str, side: int) -> NDArray:
    """(side, side, 3) uint8 of what an equirectangular picture (H, 2H, 3) uint8 shows through a face."""
    height, width = picture.shape[:2]
    x, y = np.moveaxis(places(rays(side) @ FACES[name], height) - 0.5, -1, 0)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    across, down = (x - left)[..., None], (y - top)[..., None]

    def at(row: NDArray, column: NDArray) -> NDArray:
        beyond = (row < 0) | (row >= height)  # a pole, beyond which the opposite longitude follows
        row = np.where(row < 0, -1 - row, np.where(row >= height, 2 * height - 1 - row, row))
        return picture[row, np.where(beyond, column + height, column) % width].astype(np.float64)

    above = at(top, left) * (1 - across) + at(top, left + 1) * across
    below = at(top + 1, left) * (1 - across) + at(top + 1, left + 1) * across
    return np.rint(above * (1 - down) + below * down).astype(np.uint8)


def kept(name: str, side: int, left_out: Sequence[Wedge]) -> NDArray:
    """(side, side) bool, which of a face's pixels no wedge holds."""
    directions = rays(side) @ FACES[name]
    held = np.zeros((side, side), bool)
    for wedge in left_out:
        held |= wedge.holds(directions)
    return ~held


def check_shape(height: int, width: int, where: str) -> None:
    """InputError that names a picture which is no whole equirectangular one."""
    if width != 2 * height:
        fault = f"{width}x{height} pixels, expected twice as wide as high, as whole equirectangular pictures are"
        stereo = "; two above each other are stereo, of which ffmpeg's filter crop takes one" if width == height else ""
        raise InputError(f"{fault}{stereo}", where=where)


def check_whole(photo: Path) -> None:
    """InputError where a photo says that it is a part of a sphere, as a phone's panorama is."""
    with photo.open("rb") as file:
        sides = {(kind, side): int(pixels) for kind, side, pixels in _AREA.findall(file.read(_HEAD_BYTES))}
    kinds = (b"FullPano", b"CroppedAreaImage")
    full, area = ([sides.get((kind, side)) for side in (b"Width", b"Height")] for kind in kinds)
    if None not in (*full, *area) and full != area:
        said = "a part of a sphere, {}x{} of {}x{} pixels".format(*area, *full)
        raise InputError(f"{said}; expected the whole one, or photos that are no panoramas", where=str(photo))


def side_of(height: int) -> int:
    """Pixels of a face's side, of a picture so high: about as many to a degree as that has, in the faces' middles."""
    return max(2 * round(height / math.pi), 16)


def says_panorama(path: Path) -> bool:
    """Whether a photo or a video says of itself that it is equirectangular; False where it cannot be read."""
    try:
        with path.open("rb") as file:
            start = file.read(_HEAD_BYTES)
            if start[4:8] != b"ftyp":
                return _XMP.search(start) is not None
            movie = _movie(file)
    except OSError:
        return False
    sphere = movie.find(b"sv3d")
    return (sphere >= 0 and b"equi" in movie[sphere : sphere + 512]) or (
        _UUID in movie and re.search(rb"ProjectionType>\s*equirectangular", movie) is not None
    )


def _movie(file) -> bytes:  # type: ignore[no-untyped-def]
    """The box `moov` of an MP4 file, or nothing."""
    position, size = 0, file.seek(0, 2)
    while position + 16 <= size:
        file.seek(position)
        head = file.read(16)
        length = int.from_bytes(head[:4], "big")
        length = int.from_bytes(head[8:], "big") if length == 1 else length or size - position
        if head[4:8] == b"moov":
            file.seek(position)
            return bytes(file.read(min(length, _MOVIE_BYTES)))
        if length < 8:
            break
        position += length
    return b""
