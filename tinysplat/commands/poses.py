"""`tinysplat poses`: photos without cameras to a scene folder, by structure from motion with pycolmap."""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import image_size, jpeg_bytes, png_bytes
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE, camera_entry, lens_entry
from tinysplat_runtime.scene.intake.colmap_worker import model_arrays
from tinysplat_runtime.scene.intake.depths import depth_range
from tinysplat_runtime.scene.lenses import Lens
from tinysplat_runtime.scene.scenes import Frame
from tinysplat_runtime.system.files import write_atomically
from tinysplat_runtime.system.progress import progress, working

HELP = "camera poses of photos, as a scene folder"
NEEDS = ("pycolmap",)

SUFFIXES = (".jpg", ".jpeg", ".png")

MAX_EXHAUSTIVE = 150
"""Up to as many photos every pair is matched; beyond, photos are taken to be in capture order."""

_SEED = 0  # of RANSAC: the same photos give the same poses


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Finds where each photo was taken from, takes lens distortion out, and writes photos, cameras.json, near and"
        " far. The scene's unit is arbitrary. Photos that could not be placed are named on standard error."
    )
    parser.add_argument("photos", metavar="PHOTOS", help="folder of .jpg and .png photos of one static place")
    parser.add_argument("-o", "--output", required=True, metavar="SCENE", help="folder to write, new or empty")


def run(args: Namespace) -> None:
    """Place the photos, write the scene, say which are missing."""
    import pycolmap

    photos, output = Path(args.photos), Path(args.output)
    names = _photo_names(photos)
    _check_output(output)
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    with tempfile.TemporaryDirectory() as work:
        model = _reconstruct(photos, names, Path(work), args.threads or -1, quiet=args.quiet)
    arrays = model_arrays(model)
    entries = json.loads(arrays["entries"].tobytes())
    views, points = arrays["observations"].T
    w2c = np.array([entry["w2c"] for entry in entries])  # (V, 3, 4)
    near, far = depth_range((w2c[views, 2, :3] * arrays["points"][points]).sum(axis=1) + w2c[views, 2, 3])
    placed = _write_scene(output, photos, entries, (near, far), quiet=args.quiet)
    missing = sorted(set(names) - set(placed))
    if missing:
        print(f"{photos}: {len(missing)} of {len(names)} photos could not be placed: {', '.join(missing)}",
              file=sys.stderr)  # fmt: skip
    if not args.quiet:
        print(f"{output}: {len(placed)} photos, near {near:.4g}, far {far:.4g}")


def _photo_names(folder: Path) -> list[str]:
    if not folder.is_dir():
        raise InputError("no such folder" if not folder.exists() else "a file, expected a folder", where=str(folder))
    names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    heic = [path.name for path in folder.iterdir() if path.suffix.lower() in (".heic", ".heif")]
    if heic and len(names) < 2:
        advice = f"`heif-convert {heic[0]} {Path(heic[0]).stem}.jpg`, or a phone's `most compatible` format"
        raise InputError(f"{len(heic)} HEIC photos, expected JPEG or PNG: {advice}", where=str(folder))
    if len(names) < 2:
        raise InputError(f"{len(names)} photos ({', '.join(SUFFIXES)}), expected 2 or more", where=str(folder))
    return names


def _check_output(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("exists and is not an empty folder", where=str(folder))
    if not folder.resolve().parent.is_dir():
        raise InputError(f"folder {folder.parent} does not exist; create it first", where=str(folder))


def _reconstruct(photos: Path, names: Sequence[str], work: Path, threads: int, *, quiet: bool) -> Any:
    """The model that places most photos."""
    import pycolmap

    sizes = {image_size(photos / name) for name in names}
    mode = pycolmap.CameraMode.SINGLE if len(sizes) == 1 else pycolmap.CameraMode.AUTO
    database = work / "database.db"
    pycolmap.set_random_seed(_SEED)
    extraction = pycolmap.FeatureExtractionOptions(num_threads=threads, use_gpu=False)
    matching = pycolmap.FeatureMatchingOptions(num_threads=threads, use_gpu=False)
    with working(f"features of {len(names)} photos", quiet=quiet):
        pycolmap.extract_features(database, photos, list(names), mode, extraction_options=extraction)
    match = pycolmap.match_exhaustive if len(names) <= MAX_EXHAUSTIVE else pycolmap.match_sequential
    with working("matching them", quiet=quiet):
        match(database, matching_options=matching)
    (work / "model").mkdir()
    mapping = pycolmap.IncrementalPipelineOptions(num_threads=threads, random_seed=_SEED, min_model_size=2)
    with working("placing cameras", quiet=quiet):
        models = pycolmap.incremental_mapping(database, photos, work / "model", mapping)
    if not models:
        raise InputError(
            "no photos could be placed: they need texture, overlap, and to be taken from different places",
            where=str(photos),
        )
    return max(models.values(), key=lambda model: model.num_reg_images())


def _write_scene(
    output: Path, photos: Path, entries: Sequence[dict[str, Any]], depths: tuple[float | None, float | None], *,
    quiet: bool,
) -> list[str]:  # fmt: skip
    """Write a scene folder; returns the names of the photos in it. Nothing stays behind when it fails."""
    existed = output.exists()
    (output / "images").mkdir(parents=True)
    try:
        frames, names = [], []
        order = sorted(entries, key=lambda entry: str(entry["name"]))
        for entry in progress(order, len(order), "undistort", quiet=quiet):
            camera = entry["camera"]
            lens = Lens(camera["model"], tuple(camera["params"]), camera["width"], camera["height"])
            view = lens.camera(np.linalg.inv(np.vstack([entry["w2c"], [0, 0, 0, 1]])))
            taken = Frame(view, photos / entry["name"], lens=lens).resized(lens.height, lens.width)
            file = _write_photo(output, entry["name"], taken)
            frames.append({**camera_entry(file, taken.camera), "taken_with": lens_entry(lens)})
            names.append(entry["name"])
        document = {"near": depths[0], "far": depths[1], "frames": frames}
        write_atomically(output / CAMERAS_FILE, (json.dumps(document, indent=1) + "\n").encode())
    except BaseException:
        shutil.rmtree(output if not existed else output / "images", ignore_errors=True)
        raise
    return names


def _write_photo(output: Path, name: str, frame: Frame) -> str:
    """Write a frame's picture as a file of the photo's own kind; returns its place in the scene folder."""
    image, suffix = frame.image(), Path(name).suffix.lower()
    file = f"images/{Path(name).stem}{suffix}"
    write_atomically(output / file, png_bytes(image) if suffix == ".png" else jpeg_bytes(image, quantiser=2))
    return file
