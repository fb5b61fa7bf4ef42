"""What other trackers' files have in common: cameras by the names of photos, which lie in a folder nearby."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, within
from ..images import image_size
from ..lenses import Lens
from ..scenes import Frame, Scene, even_sizes
from .depths import depth_range_in_view
from .fields import MAX_PATH_LENGTH
from .photos import find_folder, find_photo, frames_there, is_there, lens_of_copy

FOLDERS = ("images", "photos", "")
"""Where photos lie beside a tracker's file, or one folder up."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """A photo's camera as a tracker has it.

    Attributes:
        name: of the photo, in whatever folder it lay.
        c2w: (4, 4) float64, OpenCV axes.
        lens: of a photo of a size, (height, width), which files do not always state.
    """

    name: str
    c2w: NDArray
    lens: Callable[[tuple[int, int]], Lens]


@dataclass(frozen=True, eq=False)
class Track:
    """What a tracker's file says.

    Attributes:
        cameras: of its photos.
        points: (N, 3) float64, on what they show.
    """

    cameras: Sequence[Tracked]
    points: NDArray = field(default_factory=lambda: np.zeros((0, 3)))


def load_track(file: Path, read: Callable[[Path], Track]) -> Scene:
    """The scene of a tracker's file, between the depths of its points.

    Raises:
        InputError: names the file and the camera or field at fault, or says that none of the photos is there.
    """
    with within(str(file)):
        track = read(file)
        if not track.cameras:
            raise InputError("no camera with a pose")
        if long := next((camera.name for camera in track.cameras if len(camera.name) > MAX_PATH_LENGTH), ""):
            raise InputError(f"a name of {len(long)} characters, accepted are {MAX_PATH_LENGTH}", where=long[:40])
        cameras = sorted(track.cameras, key=lambda camera: camera.name)
        photos = _photos(file.parent, [camera.name for camera in cameras])
        if not any(is_there(photo) for photo in photos):
            raise InputError(f"none of its {len(photos)} photos ({photos[0].name}, …) is beside it or in images/")
        frames = frames_there(photos, str(file), lambda i: _frame(cameras[i], photos[i]))
    depths = depth_range_in_view(track.points, [frame.camera for frame in frames])
    return Scene(file.parent, even_sizes(frames), *depths)


def _frame(camera: Tracked, photo: Path) -> Frame:
    with within(camera.name[:60]):
        return Frame.through(lens_of_copy(camera.lens(image_size(photo)), photo), camera.c2w, photo)


def _photos(folder: Path, names: Sequence[str]) -> list[Path]:
    """Photos in the folder that has most of them; what lies before their names is another machine's, or a part."""
    places = (find_folder(base, name) for base in (folder, folder.parent) for name in FOLDERS)
    roots = [place for place in places if place is not None]
    found = [[_photo(root, name) for name in names] for root in roots]
    return max(found, key=lambda photos: sum(is_there(photo) for photo in photos))


def _photo(root: Path, name: str) -> Path:
    path = PureWindowsPath(name)
    inside = path.parts if not path.anchor and ".." not in path.parts else ()
    relative = find_photo(root, "/".join(inside)) if inside else root
    return relative if is_there(relative) else find_photo(root, path.name)


def numbers(where: str, words: object, count: int) -> NDArray:
    """(count,) float64 finite numbers, of words or of a list of numbers or words.

    Raises:
        InputError: others; names what they are.
    """
    given = words.split() if isinstance(words, str | bytes) else words
    try:
        values = np.array([float(value) for value in given], np.float64)  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        values = np.full(1, np.nan)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise InputError(f"{str(words)[:40]!r}, expected {count} finite numbers", where=where)
    return values


def number(where: str, word: object) -> float:
    """One number; errors of `numbers`."""
    return float(numbers(where, [word], 1)[0])


def turned(w: float, x: float, y: float, z: float) -> NDArray:
    """(3, 3) of a unit quaternion."""
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * (w * across + across @ across)
