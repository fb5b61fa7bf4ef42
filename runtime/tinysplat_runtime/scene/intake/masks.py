"""Masks beside photos, as other tools keep them, and photos that are transparent.

Of a photo `images/a.jpg` they are, in one of `FOLDERS`, `a.png`, `a_mask.png` (Metashape) or `a.jpg.png` (COLMAP);
beside the photo itself `a.mask.png`, `a_mask.png`, `a.jpg.png` or `a.jpg.mask.png` (RealityScan); or what nerfstudio's
`mask_path` names. Black is left out everywhere but in instant-ngp's `dynamic_mask_a.png`, whose white is. A single mask
in a folder, or `mask.png`, is that of all photos. Of the two meanings (`scene.masks`) files have that of those tools,
which leave out what moves; where a photo is transparent, there is nothing.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

from ...errors import warn
from ...system.printable import enumerated
from ..images import is_transparent
from ..masks import Mask
from ..scenes import Scene
from .photos import ALL, INVERTED, MASK_ENDS, find_folder, find_photo, is_photo, is_there

FOLDERS = ("masks", "mask", "_mask", ".mask", "masks_2", "masks_4", "masks_8")

_MOST_MASKS = 1 << 17  # that are looked at in a folder


def with_masks(scene: Scene) -> Scene:
    """A scene whose frames have the masks that are there; those that fit no photo, and photos without, are said."""
    named = [frame.mask if frame.mask and is_there(frame.mask.path) else None for frame in scene.frames]
    if gone := [frame.mask.path.name for frame in scene.frames if frame.mask and not is_there(frame.mask.path)]:
        warn(f"{scene.path}: {len(gone)} masks that its mask_path names are not there ({enumerated(gone)})")
    masks = masks_of([frame.path for frame in scene.frames], scene.path, named)
    pairs = zip(scene.frames, masks, strict=True)
    return replace(
        scene, frames=tuple(frame if frame.mask == mask else replace(frame, mask=mask) for frame, mask in pairs)
    )


def masks_of(photos: Sequence[Path], root: Path, named: Sequence[Mask | None] = ()) -> list[Mask | None]:
    """What says which pixels of photos count, None where all do; says what fits no photo, and photos without a mask.

    Args:
        photos: the files.
        root: the folder up to which folders of masks are sought.
        named: masks that are known already, None where they are not.
    """
    folders: dict[Path, None] = {}
    known = named or [None] * len(photos)
    masks = [own or _mask_of(photo, root, folders) for photo, own in zip(photos, known, strict=True)]
    given = {mask.path for mask in masks if mask and not mask.is_opacity}
    inside = (path for folder in folders for path in islice(sorted(folder.rglob("*")), _MOST_MASKS))
    there = [path for path in inside if is_photo(path.name)]
    unfit = [path for path in there if path not in given]
    lone = unfit if len(there) == 1 else [find_photo(folder, f"{ALL}.png") for folder in _folders(photos, root)]
    if every := next((path for path in lone if path not in photos and is_there(path)), None):
        masks = [mask or Mask(every, is_background=False) for mask in masks]
        unfit = [path for path in unfit if path != every]
        given.add(every)
    if unfit:
        warn(f"{root}: {len(unfit)} of {len(there)} masks fit no photo and are not used ({_names(unfit)})")
    used = {*given, *photos, *folders, *there}
    alike = [path for folder in _folders(photos, root) for path in _like_masks(folder) if path not in used]
    if alike:
        said = f"{_names(alike)} have the name of masks, but not of one of these photos: not used"
        warn(f"{root}: {said}; masks/NAME.png, NAME_mask.png or NAME.jpg.mask.png are")
    bare = [photo.name for photo, mask in zip(photos, masks, strict=True) if mask is None]
    if given and bare:
        warn(f"{root}: {len(bare)} of {len(masks)} photos have no mask and count as they are ({enumerated(bare)})")
    return masks


def _folders(photos: Sequence[Path], root: Path) -> list[Path]:
    """The folders of photos, and that which all are in."""
    return sorted({root, *(photo.parent for photo in photos)})


def _like_masks(folder: Path) -> list[Path]:
    """Pictures and folders that are named after masks."""
    try:
        named = [path for path in sorted(folder.iterdir()) if ALL in path.name.lower() and path.name[:2] != "._"]
    except OSError:
        return []
    return [path for path in named if is_photo(path.name) or is_there(path, Path.is_dir)]


def _names(paths: Sequence[Path]) -> str:
    return enumerated([path.name for path in paths])


def _mask_of(photo: Path, root: Path, folders: dict[Path, None]) -> Mask | None:
    """The mask of a photo; folders of masks that there are are added to `folders`."""
    for path in _places(photo, root, folders):
        if is_there(path):
            return Mask(path, is_background=False, is_inverted=path.name.lower().startswith(INVERTED))
    return Mask(photo, is_background=True, is_opacity=True) if is_transparent(photo) else None


def _places(photo: Path, root: Path, folders: dict[Path, None]) -> Iterator[Path]:
    """Where a photo's mask may lie."""
    names = (*(f"{name}{end}" for name in (photo.stem, photo.name) for end in MASK_ENDS), f"{INVERTED}{photo.stem}")
    for name in names:
        yield find_photo(photo.parent, f"{name}.png")
    yield photo.with_name(f"{photo.name}.png")
    for base in (base for base in photo.parents if base == root or root in base.parents):
        folder = next((found for name in FOLDERS if (found := find_folder(base, name))), None)
        if folder is None:
            continue
        folders[folder] = None
        parts = photo.relative_to(base).parts[:-1]
        for inside in dict.fromkeys((parts, parts[1:])):
            for name in (photo.name, photo.stem, *names):
                yield find_photo(folder, "/".join((*inside, f"{name}.png")))
