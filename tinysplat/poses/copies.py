"""Photos as COLMAP is given them: one of each, upright, under names that its lists hold."""

import hashlib
import itertools
import shutil
from collections.abc import Sequence
from pathlib import Path

from numpy.typing import NDArray

from tinysplat_runtime.scene.heic import SUFFIXES as HEIC
from tinysplat_runtime.scene.images import is_turned, read_image
from tinysplat_runtime.scene.pictures import jpeg_bytes, png_bytes
from tinysplat_runtime.scene.pillow import SUFFIXES as OTHERS
from tinysplat_runtime.system.told import NOBODY, Told


def copies(photos: Path, names: Sequence[str]) -> dict[str, str]:
    """Photos that are byte for byte others, by name, and which they are."""
    first: dict[bytes, str] = {}
    first_of = {}
    for name in names:
        seen = first.setdefault(hashlib.sha256((photos / name).read_bytes()).digest(), name)
        if seen != name:
            first_of[name] = seen
    return first_of


def upright_copies(photos: Path, names: Sequence[str], folder: Path, told: Told = NOBODY) -> tuple[dict[str, str], int]:
    """Photos in a folder as a viewer shows them, by links where that is how they are stored; other kinds as JPEG.

    Returns:
        What each is called there, by name, and how many their Exif orientation turns.
    """
    called: dict[str, str] = {}
    turned = 0
    for name in told.progress("copying photos", names):
        stem, suffix = "_".join(Path(name).stem.split()), Path(name).suffix.lower()  # COLMAP's lists split at spaces
        is_foreign = suffix in (*HEIC, *OTHERS)  # to COLMAP
        kind = ".jpg" if is_foreign else suffix
        free = (f"{stem}{f'_{n}' if n > 1 else ''}{kind}" for n in itertools.count(1))
        copy = called[name] = next(one for one in free if not (folder / one).exists())
        if is_foreign or is_turned(photos / name):
            turned += suffix not in HEIC and is_turned(photos / name)
            (folder / copy).write_bytes(encoded(read_image(photos / name), copy))
            continue
        try:
            (folder / copy).symlink_to((photos / name).resolve())
        except OSError:  # a system without links
            shutil.copyfile(photos / name, folder / copy)
    return called, turned


def encoded(image: NDArray, name: str) -> bytes:
    """A picture (H, W, 3) uint8 as a file of the kind that a name says: PNG, or JPEG of the best quality."""
    return png_bytes(image) if Path(name).suffix.lower() == ".png" else jpeg_bytes(image, quantiser=2)
