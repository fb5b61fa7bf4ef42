"""COLMAP projects: photos, and a model of their cameras (`colmap_model`).

A project folder holds the photos in `images/` and a model in `sparse/0`, or in another of `MODEL_FOLDERS`; a folder
with the model's own files works as well, its photos beside it. Of several models the largest is read. The depth range
is that of the points which the photos observe, if there are any. Pixel centres lie at halves and axes are OpenCV's, as
here, so that nothing is converted.
"""

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
    "distorted/sparse", "distorted/sparse/*",
)  # fmt: skip
"""Where tools put models, the likelier first; a folder may be a model itself, too."""

_MOST_MODELS = 200
_NEEDED, _SUFFIXES = ("cameras", "images"), (".bin", ".txt")
_DISTORTED, _FOLDERS = "distorted", ("images", "input")  # of photos; 3DGS calls them as they were taken `input`
_HEADER = re.compile(rb"#\s*Number of images:\s*(\d{1,9})")
_HEADER_BYTES = 1000


def model_folder(folder: Path) -> Path | None:
    """Where a project folder keeps its largest model, or None; 3DGS' models of distorted photos come last.

    Raises:
        InputError: there is no model, but half of one.
    """
    found = max(_models(folder), key=lambda model: (_DISTORTED not in model.parts, _size(model)), default=None)
    for place in _places(folder) if found is None else ():
        there = {file.name for part in _NEEDED for file in place.glob(f"{part}.*") if file.suffix in _SUFFIXES}
        if there:
            lacking = " or ".join(
                f"{part}{end}" for end in _SUFFIXES for part in _NEEDED if f"{part}{end}" not in there
            )
            raise InputError(f"a COLMAP model of {', '.join(sorted(there))} lacks {lacking}", where=str(place))
    return found


def _models(folder: Path) -> list[Path]:
    """Folders with a model, the likelier first."""
    return [place for place in (*_places(folder), folder) if _suffix(place)]


def _places(folder: Path) -> list[Path]:
    inside = (place for pattern in MODEL_FOLDERS for place in sorted(folder.glob(pattern)))
    return [*islice((place for place in inside if not place.name.startswith(".")), _MOST_MODELS)]


def _suffix(model: Path) -> str:
    """`.bin` or `.txt`, where a folder has a model, else nothing."""
    having = (end for end in _SUFFIXES if all((model / f"{part}{end}").is_file() for part in _NEEDED))
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
    names_of_folders = _FOLDERS[:: -1 if _DISTORTED in model.parts else 1]
    roots = [root for place in above for name in (*names_of_folders, "") if (root := find_folder(place, name))]
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
