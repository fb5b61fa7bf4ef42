"""The doors to scenes, `load_scene` and `load_cameras`: which tool wrote one is told by the files that are there."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from ...errors import InputError, check_is
from ...system.files import StrPath
from ..cameras import Camera
from ..footage import SUFFIXES
from ..images import PHOTO_SUFFIXES
from ..scenes import Scene
from . import bundler, meshroom, metashape, realityscan
from .cameras_json import CAMERAS_FILE, cameras_alone, load_folder
from .colmap import load_colmap, model_folder
from .exports import Reader, export_reader
from .llff import LLFF_FILE, load_llff
from .masks import with_masks
from .nerfstudio import BLENDER_FILE, FILE, load_transforms
from .photos import photos_in
from .realestate import load_realestate
from .tracked import Track, load_track

NOT_READ = {
    "*.psx": "Metashape are read from what `Export Cameras` writes (.xml), not from its projects",
    "*.psz": "Metashape are read from what `Export Cameras` writes (.xml), not from its projects",
    "*.mg": "Meshroom are read from `cameras.sfm` of its node StructureFromMotion",
    "MeshroomCache": "Meshroom are read from `cameras.sfm` of its node StructureFromMotion",
}
"""Files of tools whose cameras are in other files."""

TRACKERS: dict[str, tuple[bytes, Callable[[Path], Track]]] = {
    "*.xml": (metashape.SIGN, metashape.read_metashape),
    "*.csv": (realityscan.SIGN, realityscan.read_realityscan),
    "*.out": (bundler.SIGN, bundler.read_bundler),
    "*.sfm": (meshroom.SIGN, meshroom.read_meshroom),
}
"""Files of trackers: a sign in their first bytes, and what reads them."""

_SIGN_BYTES = 4096
_MOST_FOLDERS = 200  # that are searched for photos

POSES = "with a RealEstate10K .txt, a transforms.json or a folder with a COLMAP model"
GAUSSIAN_FILES = ".ply .npz .spz .splat .sog .glb .gltf .safetensors .usd .usda .usdc .usdz"
OTHER_FILES = dict.fromkeys(
    GAUSSIAN_FILES.split(), "holds Gaussians; `tinysplat compress {path} -o F.tsplat` codes them"
) | {".tsplat": "coded already, `tinysplat view {path}` shows it", ".zip": "an archive; unpack it and name the folder"}
"""Endings of what is often taken for a scene, and what to do with it."""

ACCEPTED = f"{CAMERAS_FILE}, {FILE}, {BLENDER_FILE}, {LLFF_FILE} or a COLMAP model in sparse/"


def load_scene(path: StrPath, near: float | None = None, far: float | None = None) -> Scene:
    """Read a scene's cameras; its photos are read when asked for.

    Args:
        path: a folder with `cameras.json`, with nerfstudio's or instant-ngp's `transforms.json`, or with a COLMAP model
            in `sparse/`, with Blender's `transforms_train.json` or LLFF's `poses_bounds.npy`; one of these .json files;
            what Polycam, Record3D, OpenSfM, Metashape, RealityScan, Bundler or Meshroom export; or a RealEstate10K
            camera file (.txt). For a video and poses see `video.video_scene`.
        near: replaces the scene's own near depth, scene units.
        far: replaces the scene's own far depth.

    Raises:
        InputError: names the file and the field at fault.
    """
    check_is(path, str | os.PathLike, "scene", "a path")
    if "://" in str(path):
        raise InputError(
            "a URL, expected a file or folder on this machine (`tinysplat batch` takes URLs)", where=str(path)
        )
    path = Path(path)
    reader = foreign_reader(path)
    return with_masks(reader(path) if reader else load_folder(_cameras_file(path))).between(near, far)


def load_cameras(path: StrPath) -> list[Camera]:
    """Read the cameras of anything that `load_scene` takes; frames of a `cameras.json` need name no photo.

    Raises:
        InputError: names the file and the field at fault.
    """
    path = Path(path)
    reader = foreign_reader(path)
    return reader(path).cameras if reader else cameras_alone(_cameras_file(path))


def foreign_reader(path: Path) -> Reader | None:
    """What reads a scene of another tool's; None where it is ours, or nothing known."""
    if path.is_dir():
        if (path / CAMERAS_FILE).exists():
            return None
        if (path / FILE).exists() or (path / BLENDER_FILE).exists():
            return load_transforms
        if (path / LLFF_FILE).exists():
            return load_llff
        if model_folder(path) is not None:
            return load_colmap
        return export_reader(path) or _tracker(path)
    if path.suffix == ".json" and path.name.startswith("transforms"):
        return load_transforms
    if (tracker := _tracker(path)) is not None:
        return tracker
    if path.suffix.lower() in SUFFIXES:
        advice = f"`tinysplat poses {path} -o SCENE` finds them; or --poses {POSES}"
        raise InputError(f"a video needs its cameras: {advice}", where=str(path))
    if (other := OTHER_FILES.get(path.suffix.lower())) is not None:
        raise InputError(f"{other.format(path=path)}, expected photos and their cameras", where=str(path))
    if path.suffix.lower() in PHOTO_SUFFIXES:
        raise InputError("one photo, expected a scene: a folder of two or more and their cameras", where=str(path))
    return load_realestate if path.suffix == ".txt" else None


def _tracker(path: Path) -> Reader | None:
    """What reads a tracker's file, or the largest such file of a folder; None where it is none."""
    for pattern, (sign, read) in TRACKERS.items():
        files = [*path.glob(pattern)] if path.is_dir() else [path] if path.match(pattern) else []
        signed = [file for file in files if not file.name.startswith(".") and _has(file, sign)]
        if signed:
            file = max(signed, key=lambda file: file.stat().st_size)
            return lambda _: load_track(file, read)
    return None


def _has(file: Path, sign: bytes) -> bool:
    """Whether a file begins with a sign, whatever stands before it."""
    try:
        with file.open("rb") as stream:
            return re.search(sign, stream.read(_SIGN_BYTES)) is not None
    except OSError:
        return False


def _cameras_file(path: Path) -> Path:
    if path.is_dir() and not (path / CAMERAS_FILE).exists():
        tool = next((f"cameras of {tool}; " for sign, tool in NOT_READ.items() if any(path.glob(sign))), "")
        inner = (folder for pattern in ("*", "*/*") for folder in sorted(path.glob(pattern)) if folder.is_dir())
        folders = [path, *islice(inner, _MOST_FOLDERS)]  # two levels deep: where tools keep their photos
        photos, folder = max(((len(photos_in(folder)), folder) for folder in folders), key=lambda pair: pair[0])
        only = ", only photos" if photos and folder == path else ""
        advice = f"{only}; `tinysplat poses {folder} -o SCENE` finds the photos' cameras" if photos else ""
        raise InputError(f"{tool}no {ACCEPTED} in this folder{advice}", where=str(path))
    return path / CAMERAS_FILE if path.is_dir() else path
