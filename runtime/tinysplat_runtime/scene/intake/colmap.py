"""COLMAP projects: photos, and a model of their cameras (`colmap_model`).

A project folder holds the photos in `images/` and a model in `sparse/0`, or in another of `MODEL_FOLDERS`; a folder
with the model's own files works as well, its photos beside it. Of several models the largest is read. The depth range
is that of the points which the photos observe, if there are any. Pixel centres lie at halves and axes are OpenCV's, as
here, so that nothing is converted.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np

from ...errors import InputError, warn, within
from ...system.files import stays_inside
from ..lenses import Lens
from ..scenes import Frame, Scene, even_sizes
from .colmap_model import ModelPhoto, read_model
from .depths import depth_range_in_view, observed_range
from .photos import find_folder, find_photo, frames_there, is_there, lens_of_copy

MODEL_FOLDERS = (
    "sparse", "sparse/*", "colmap/sparse", "colmap/sparse/*", "dense/sparse", "dense/*/sparse", "colmap",
)  # fmt: skip
"""Where tools put models, the likelier first; a folder may be a model itself, too."""

_MOST_MODELS = 200
_NEEDED = ("cameras", "images")
_HEADER = re.compile(rb"#\s*Number of images:\s*(\d{1,9})")
_HEADER_BYTES = 1000


def model_folder(folder: Path) -> Path | None:
    """Where a project folder keeps its largest model, or None."""
    return max(_models(folder), key=_size, default=None)


def _models(folder: Path) -> list[Path]:
    """Folders with a model, the likelier first."""
    inside = (place for pattern in MODEL_FOLDERS for place in sorted(folder.glob(pattern)))
    named = (place for place in inside if not place.name.startswith("."))
    return [place for place in (*islice(named, _MOST_MODELS), folder) if _suffix(place)]


def _suffix(model: Path) -> str:
    """`.bin` or `.txt`, where a folder has a model, else nothing."""
    having = (end for end in (".bin", ".txt") if all((model / f"{part}{end}").is_file() for part in _NEEDED))
    return next(having, "")


def _size(model: Path) -> int:
    """About how many photos a model has: exactly where it is binary."""
    file = model / f"images{_suffix(model)}"
    try:
        with file.open("rb") as stream:
            if file.suffix == ".bin":
                return min(int.from_bytes(stream.read(8), "little"), file.stat().st_size)
            return sum(not line.startswith(b"#") for line in stream) // 2
    except OSError:
        return 0


def load_colmap(folder: Path) -> Scene:
    """Read a COLMAP project; photos in the order of their names.

    Raises:
        InputError: the model is damaged or has no photo with a pose, a camera is none, or pycolmap is missing for its
            distortion.
    """
    model = model_folder(folder)
    if model is None:
        raise InputError(f"no COLMAP model in {', '.join(MODEL_FOLDERS)}", where=str(folder))
    _say_others(folder, model)
    found = read_model(model, _suffix(model))
    if not found.photos:
        raise InputError("a model without a photo that has a pose", where=str(model))
    entries = sorted(found.photos, key=lambda photo: photo.name)
    with within(str(model)):
        for entry in entries:
            if not stays_inside(entry.name):
                raise InputError(f"'{entry.name[:60]}' leaves the folder of the photos", where="images")
        photos = _photos(folder, model, [entry.name for entry in entries])
        frames = frames_there(photos, str(model), lambda i: _frame(photos[i], entries[i]))
    w2c = np.stack([photo.w2c for photo in found.photos])  # (V, 3, 4)
    depths = observed_range(w2c, found.points, found.observations)
    if None in depths:
        depths = depth_range_in_view(found.points, [frame.camera for frame in frames])
    return Scene(folder, even_sizes(frames), *depths)


def _say_others(folder: Path, model: Path) -> None:
    """Say which other models there are that have other photos, and how many a text's header promises."""
    sizes = {place: _size(place) for place in _models(folder)}
    if smaller := [place for place, size in sizes.items() if size < sizes[model]]:
        others = ", ".join(f"{place.relative_to(folder)} has {sizes[place]} photos" for place in smaller[:3])
        warn(f"{folder}: reads {model.relative_to(folder)}, with {sizes[model]} photos the largest model; {others}")
    if _suffix(model) == ".txt":
        with (model / "images.txt").open("rb") as file:
            stated = _HEADER.search(file.read(_HEADER_BYTES))
        if stated and int(stated[1]) > sizes[model]:
            warn(f"{model}: {sizes[model]} photos, but the header of images.txt says that they are {int(stated[1])}")


def _photos(folder: Path, model: Path, names: Sequence[str]) -> list[Path]:
    """Where the photos of these names lie: in the folder nearest to the model that has one of them."""
    above = [Path(os.path.normpath(model / up)) for up in ("", "..", "../..", "../../..")]
    roots = [root for place in above for root in (find_folder(place, "images"), place) if root is not None]
    for root in roots:
        photos = [find_photo(root, name) for name in names]
        if any(is_there(photo) for photo in photos):
            return photos
    return [folder / "images" / name for name in names]


_lens = lru_cache(maxsize=256)(Lens)
"""One object for all photos of a camera: finding its camera without distortion takes 4 ms at 4000×3000."""


def _frame(photo: Path, entry: ModelPhoto) -> Frame:
    with within(entry.name):
        lens = lens_of_copy(_lens(*entry.camera), photo)
        return Frame.through(lens, np.linalg.inv(np.vstack([entry.w2c, [0, 0, 0, 1]])), photo)
