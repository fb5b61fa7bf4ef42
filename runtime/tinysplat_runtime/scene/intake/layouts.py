"""Which tool wrote a scene: told by the files that are there, without reading them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...errors import InputError
from ..footage import SUFFIXES
from ..scenes import CAMERAS_FILE, Scene
from .colmap import load_colmap, model_folder
from .nerfstudio import FILE, load_transforms
from .realestate import load_realestate

Reader = Callable[[Path, float | None, float | None], Scene]
"""Takes a path, near and far; the latter two replace the scene's own where they are not None."""

POSES = "with a RealEstate10K .txt, a transforms.json or a folder with a COLMAP model"
ACCEPTED = f"{CAMERAS_FILE}, {FILE} or a COLMAP model in sparse/"


def foreign_reader(path: Path) -> Reader | None:
    """What reads a scene of another tool's; None where it is ours, or nothing known."""
    if path.is_dir():
        if (path / CAMERAS_FILE).exists():
            return None
        if (path / FILE).exists():
            return load_transforms
        return load_colmap if model_folder(path) is not None else None
    if path.suffix == ".json" and path.name.startswith("transforms"):
        return load_transforms
    if path.suffix.lower() in SUFFIXES:
        raise InputError(f"a video needs its cameras: --poses {POSES}", where=str(path))
    return load_realestate if path.suffix == ".txt" else None
