"""COLMAP models, text and binary, through the package pycolmap (extra `poses`).

A project folder holds the photos in `images/` and a model in `sparse/0`, `sparse` or `colmap/sparse/0`; a folder with
the model's own files works as well, its photos beside it. The depth range is that of the points which the photos
observe. Pixel centres lie at halves and axes are OpenCV's, as here, so that nothing is converted.

Trust boundary: on a damaged model pycolmap ends its process in place of raising, or takes all memory. It therefore
reads in a process of its own (`colmap_worker`), which hands over arrays, and only where `colmap_binary` found no
wrong count.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..cameras import Camera
from ..lenses import INSTALL, Lens
from ..scenes import Frame, Scene, even_sizes
from .colmap_binary import check_counts
from .depths import depth_range_in_view, observed_range

MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
PHOTO_FOLDERS = ("images", ".", "../images", "../../images", "../../../images")

_NEEDED = ("cameras", "images", "points3D")
_NO_PYCOLMAP = 3  # exit status of the worker


def model_folder(folder: Path) -> Path | None:
    """Where a project folder keeps its model, or None."""
    for name in MODEL_FOLDERS:
        for suffix in (".bin", ".txt"):
            if all((folder / name / f"{part}{suffix}").is_file() for part in _NEEDED):
                return folder / name
    return None


def load_colmap(folder: Path, near: float | None, far: float | None) -> Scene:
    """Read a COLMAP project; photos in the order of their names.

    Raises:
        InputError: pycolmap is missing, the model is damaged or has no photo with a pose, or a camera is none.
    """
    model = model_folder(folder)
    if model is None:
        raise InputError(f"no COLMAP model in {', '.join(MODEL_FOLDERS)}", where=str(folder))
    arrays = _read_apart(model)
    entries = json.loads(arrays["entries"].tobytes())
    if not entries:
        raise InputError("a model without a photo that has a pose", where=str(model))
    order = sorted(range(len(entries)), key=lambda i: entries[i]["name"])
    photos = _photo_folder(folder, model, entries[order[0]]["name"])
    try:
        frames = [_frame(photos, entries[i]) for i in order]
    except InputError as error:
        raise error.within(str(model)) from None
    w2c = np.stack([np.array(entry["w2c"]) for entry in entries])  # (V, 3, 4)
    depths = observed_range(w2c, arrays["points"], arrays["observations"])
    if None in depths:
        depths = depth_range_in_view(arrays["points"], [frame.camera for frame in frames])
    near, far = (given if given is not None else own for given, own in zip((near, far), depths, strict=True))
    return Scene(folder, even_sizes(frames), near, far)


def _read_apart(model: Path) -> dict[str, NDArray]:
    """What `colmap_worker` writes of a model."""
    check_counts(model)
    command = [sys.executable, "-m", "tinysplat_runtime.scene.intake.colmap_worker", str(model)]
    path = os.pathsep.join(entry for entry in sys.path if entry)  # the worker finds what this process found
    done = subprocess.run(command, capture_output=True, check=False, env={**os.environ, "PYTHONPATH": path})
    if done.returncode == _NO_PYCOLMAP:
        raise InputError(f"COLMAP models need pycolmap; {INSTALL}", where=str(model))
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        reason = lines[-1][:120] if done.returncode > 0 and lines else "pycolmap cannot read it"
        raise InputError(f"damaged COLMAP model ({reason})", where=str(model))
    with np.load(io.BytesIO(done.stdout)) as arrays:
        return dict(arrays)


def _photo_folder(folder: Path, model: Path, name: str) -> Path:
    """The folder that photo names are relative to: the first that has the first photo."""
    roots = [folder / "images", *(model / place for place in PHOTO_FOLDERS)]
    return next((root for root in roots if (root / name).is_file()), roots[0])


_lens = lru_cache(maxsize=256)(Lens)
"""One object for all photos of a camera: finding its camera without distortion takes 4 ms at 4000×3000."""


def _frame(photos: Path, entry: dict[str, object]) -> Frame:
    name = str(entry["name"])
    for path in (PurePosixPath(name), PureWindowsPath(name)):
        if path.anchor or ".." in path.parts:
            raise InputError(f"'{name[:60]}' leaves the folder of the photos", where="images")
    camera = entry["camera"]
    assert isinstance(camera, dict)  # written by our own worker
    w2c = np.vstack([np.array(entry["w2c"]), [0, 0, 0, 1]])
    try:
        lens = _lens(camera["model"], tuple(camera["params"]), camera["width"], camera["height"])
        seen: Camera = lens.camera(np.linalg.inv(w2c))
    except InputError as error:
        raise error.within(name) from None
    return Frame(seen, photos / name, lens=None if lens.is_pinhole else lens)
