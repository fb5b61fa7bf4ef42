"""Photos placed in space by COLMAP's incremental mapper, through the package pycolmap (extra `poses`).

Up to `ALL_PAIRS` photos are compared each with each. More of them are taken to be in the order in which they were taken
and compared with those shortly before, and at distances of 2, 4, 8 …; where that leaves many out and no video says so,
the order meant nothing, and each is compared with each after all.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import image_size, is_turned, jpeg_bytes, png_bytes, read_image
from tinysplat_runtime.scene.lenses import load_pycolmap
from tinysplat_runtime.system.progress import working

ALL_PAIRS = 30
"""Photos that are compared each with each at once."""

MOST_FOR_ALL_PAIRS = 150
"""Photos that are compared each with each where their order led nowhere."""

PLACED = 0.6
"""Least share of photos that are placed where their order is that of the camera's way."""

_SEED = 0  # of RANSAC: the same photos give the same poses
_OVERLAP = 6  # photos before each that it is compared with
_MANY_FEATURES, _MANY_PIXELS = 2048, 1600  # of each of many photos, which see every point often


def upright_copies(photos: Path, names: Sequence[str], folder: Path) -> list[str]:
    """Photos in a folder as a viewer shows them, by links where that is how they are stored.

    Returns:
        The names of those that their Exif orientation turns.
    """
    turned = [name for name in names if is_turned(photos / name)]
    for name in names:
        if name in turned:
            (folder / name).write_bytes(encoded(read_image(photos / name), name))
            continue
        try:
            (folder / name).symlink_to((photos / name).resolve())
        except OSError:  # a system without links
            shutil.copyfile(photos / name, folder / name)
    return turned


def encoded(image: NDArray, name: str) -> bytes:
    """A picture (H, W, 3) uint8 as a file of the kind that a name says: PNG, or JPEG of the best quality."""
    return png_bytes(image) if Path(name).suffix.lower() == ".png" else jpeg_bytes(image, quantiser=2)


def place(photos: Path, names: Sequence[str], work: Path, threads: int, *, in_order: bool, quiet: bool) -> Any:
    """The pycolmap.Reconstruction that places most of the photos.

    Args:
        photos: their folder; they are as stored, whatever their Exif orientation.
        names: in the order in which they were taken, where that is known.
        work: an empty folder for what is found on the way.
        threads: of COLMAP; -1 for all cores.
        in_order: whether the photos are known to be in order, as frames of a video are.
        quiet: whether to show no progress.

    Raises:
        InputError: none could be placed.
    """
    pycolmap = load_pycolmap()
    many = len(names) > ALL_PAIRS
    sizes = {image_size(photos / name) for name in names}
    mode = pycolmap.CameraMode.SINGLE if len(sizes) == 1 else pycolmap.CameraMode.AUTO
    database = work / "database.db"
    pycolmap.set_random_seed(_SEED)
    extraction = pycolmap.FeatureExtractionOptions(num_threads=threads, use_gpu=False)
    if many:
        extraction.max_image_size, extraction.sift.max_num_features = _MANY_PIXELS, _MANY_FEATURES
        extraction.sift.first_octave = 0
    with working(f"features of {len(names)} photos", quiet=quiet):
        pycolmap.extract_features(database, photos, list(names), mode, extraction_options=extraction)
    matching = pycolmap.FeatureMatchingOptions(num_threads=threads, use_gpu=False)
    if many:
        pairing = pycolmap.SequentialPairingOptions(overlap=_OVERLAP, quadratic_overlap=True)
        with working("matching neighbours", quiet=quiet):
            pycolmap.match_sequential(database, matching_options=matching, pairing_options=pairing)
        found = _mapped(photos, database, work / "by_order", threads, quiet=quiet)
        if in_order or len(names) > MOST_FOR_ALL_PAIRS or _placed(found) >= PLACED * len(names):
            return _checked(found, photos)
    with working("matching all pairs", quiet=quiet):
        pycolmap.match_exhaustive(database, matching_options=matching)
    return _checked(_mapped(photos, database, work / "of_all", threads, quiet=quiet), photos)


def _mapped(photos: Path, database: Path, folder: Path, threads: int, *, quiet: bool) -> Any | None:
    """The largest model that matches give."""
    pycolmap = load_pycolmap()
    folder.mkdir()
    options = pycolmap.IncrementalPipelineOptions(num_threads=threads, random_seed=_SEED, min_model_size=2)
    done = 0

    def count() -> None:
        nonlocal done
        done += 1

    with working("placing cameras", quiet=quiet, note=lambda: f"{done} placed"):
        models = pycolmap.incremental_mapping(
            database, photos, folder, options, initial_image_pair_callback=count, next_image_callback=count
        )
    return max(models.values(), key=_placed) if models else None


def _placed(model: Any | None) -> int:
    return 0 if model is None else int(model.num_reg_images())


def _checked(model: Any | None, photos: Path) -> Any:
    if model is None:
        raise InputError(
            "no photos could be placed: they need texture, overlap, and to be taken from different places",
            where=os.fspath(photos),
        )
    return model


def coloured_points(model: Any) -> tuple[NDArray, NDArray, NDArray]:
    """Points (N, 3) in the world, their colours (N, 3) uint8, and their errors (N,) in pixels."""
    points = list(model.points3D.values())
    return (
        np.array([point.xyz for point in points], np.float64).reshape(-1, 3),
        np.array([point.color for point in points], np.uint8).reshape(-1, 3),
        np.array([point.error for point in points], np.float64),
    )
