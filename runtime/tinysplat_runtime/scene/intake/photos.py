"""Photos by the names that other tools gave them, in folders as they are now.

A name that fits exactly wins. Else backslashes are those of Windows, the case of letters and the way in which accents
are written do not matter, endings may be left out or another photo's, and of a folder `images` that is not there its
smaller copies are taken (`images_2`, `images_4`, `images_8`). Names that begin with a dot are nobody's photos: macOS
leaves such files on foreign disks.
"""

import re
import time
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from ...errors import warn
from ...system.printable import enumerated
from ..images import PHOTO_SUFFIXES, image_size
from ..lenses import Lens
from ..scenes import Frame

SMALLER = {"images": ("images_2", "images_4", "images_8")}
"""Folders of the same photos, reduced, which stand in for one that is not there."""

_SETTLED_NS = 2_000_000_000  # since a folder's last change, whose time has grains

MASK_ENDS, INVERTED, ALL = (".mask", "_mask"), "dynamic_mask_", "mask"
"""Ends of a name, before the ending, of a mask beside its photo; how instant-ngp's begins, whose white is left out; and
the name of a mask of all photos."""

_COMPANION = re.compile(rf"(?:{INVERTED})?(.+?)(?:[._](?:mask|depth|normals?|alpha)(?:_\d+)?)?", re.IGNORECASE)
"""What tools put beside a photo: Blender, for instance, `a_depth_0001.png`."""


def photos_in(folder: Path) -> list[Path]:
    """The photos of a folder, in the order of their names; none where it cannot be read."""
    try:
        return sorted(path for path in folder.iterdir() if is_photo(path.name))
    except OSError:
        return []


def own_photos(folder: Path) -> list[Path]:
    """The photos of a folder but for what tools put beside them: masks, depths and normals."""
    photos = photos_in(folder)
    names = {path.name.lower() for path in photos}
    known = names | {Path(name).stem for name in names}

    def is_own(stem: str) -> bool:
        base = _COMPANION.fullmatch(stem)
        is_of_another = stem in names or (base is not None and base[1] != stem and base[1] in known)
        return not is_of_another and (stem != ALL or len(names) == 1)

    return [path for path in photos if is_own(path.stem.lower())]


def is_photo(name: str) -> bool:
    """Whether a file of this name is somebody's photo."""
    return not name.startswith(".") and Path(name).suffix.lower() in PHOTO_SUFFIXES


def is_there(path: Path, kind: Callable[[Path], bool] = Path.is_file) -> bool:
    """Whether there is such a file, or folder; a name that no file can have is none's."""
    try:
        return kind(path)
    except (OSError, ValueError):
        return False


def find_photo(folder: Path, name: str) -> Path:
    """Where the photo of a name lies that is relative to a folder; without one, where it should."""
    exact = folder / name
    if is_there(exact):
        return exact
    found: Path | None = folder
    *parts, last = name.replace("\\", "/").split("/")
    for part in parts:
        found = found and find_folder(found, part)
    found = found and _find_file(found, last)
    return found or exact


def find_folder(folder: Path, name: str) -> Path | None:
    """The folder of a name in another, in whatever case, or what stands in for it; None where there is none."""
    if name in ("", "."):
        return folder
    candidates = [name, *_listing(folder).get(_plain(name), ()), *SMALLER.get(name.lower(), ())]
    return next(
        (path for path in (folder / candidate for candidate in candidates) if is_there(path, Path.is_dir)), None
    )


def _find_file(folder: Path, name: str) -> Path | None:
    """The photo of a name in a folder, its ending left out or that of another photo."""
    path = Path(name)
    stem = path.stem if path.suffix.lower() in PHOTO_SUFFIXES else name
    names = [name, *(stem + suffix for suffix in PHOTO_SUFFIXES)]
    candidates = (other for wanted in names for other in (wanted, *_listing(folder).get(_plain(wanted), ())))
    return next((path for path in (folder / candidate for candidate in candidates) if is_there(path)), None)


def _listing(folder: Path) -> dict[str, list[str]]:
    """Names in a folder by what is left of them where case and accents do not matter."""
    try:
        changed = folder.stat().st_mtime_ns
        is_settled = time.time_ns() - changed > _SETTLED_NS
        return _kept_listing(folder, changed) if is_settled else _listed(folder)
    except OSError:
        return {}


def _listed(folder: Path) -> dict[str, list[str]]:
    by_name = defaultdict(list)
    for path in sorted(folder.iterdir()):
        by_name[_plain(path.name)].append(path.name)
    return dict(by_name)


@lru_cache(maxsize=16)
def _kept_listing(folder: Path, changed: int) -> dict[str, list[str]]:
    return _listed(folder)


def _plain(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def lens_of_copy(lens: Lens, photo: Path) -> Lens:
    """The lens of a photo, or of its smaller copy, where it lies among such and has the photo's shape."""
    if photo.parent.name not in {name for names in SMALLER.values() for name in names}:
        return lens
    height, width = image_size(photo)
    if (width, height) == (lens.width, lens.height) or abs(width * lens.height / lens.width - height) > 1:
        return lens
    return lens.scaled(width, height)


def frames_there(photos: Sequence[Path], where: str, frame: Callable[[int], Frame]) -> list[Frame]:
    """The frames of a scene's photos that are there, made by their numbers, which they keep; the others are said. All
    where none is, as beside a video.

    Photos that lie beside them and are not of the scene are counted, too.
    """
    return [replace(frame(i), number=i) for i in _there(photos, where)]


def _there(photos: Sequence[Path], where: str) -> list[int]:
    missing = [i for i, photo in enumerate(photos) if not is_there(photo)]
    if len(missing) == len(photos):
        return [*range(len(photos))]
    if missing:
        names = enumerated([photos[i].name for i in missing])
        warn(f"{where}: {len(missing)} of {len(photos)} photos are not there and left out ({names})")
    kept = sorted({*range(len(photos))}.difference(missing))
    used = {photos[i] for i in kept}
    folders = sorted({photo.parent for photo in used})
    there = {path for folder in folders for path in own_photos(folder)}.difference(photos) | used
    if len(there) > len(used):
        place = f"{folders[0].name}/" if len(folders) == 1 else f"{len(folders)} folders"
        warn(f"{where}: {len(used)} of {len(there)} photos in {place} have a camera; the others are not used")
    return kept
