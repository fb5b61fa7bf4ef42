"""Masks beside photos, as other tools keep them, and photos that are transparent.

Of a photo `images/a.jpg` they are `masks/a.png` or, as COLMAP has it, `masks/a.jpg.png`; beside the photo itself
`a.mask.png`, `a_mask.png` or `a.jpg.png`; or what nerfstudio's `mask_path` names. Black is left out everywhere. Of the
two meanings (`scene.masks`) files have that of those tools, which leave out what moves; where a photo is transparent,
there is nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path, PurePosixPath

from ...errors import warn
from ...system.printable import listed
from ..images import is_transparent
from ..masks import Mask
from ..scenes import Scene
from .photos import find_folder, find_photo, is_photo, is_there

FOLDERS = ("masks", "mask")

ENDS = (".mask", "_mask")
"""Ends of a name, before the ending, of a mask beside its photo."""

_MOST_MASKS = 1 << 17  # that are looked at in a folder


def with_masks(scene: Scene) -> Scene:
    """A scene whose frames have the masks that are there; those that fit no photo, and photos without, are said."""
    named = [frame.mask if frame.mask and is_there(frame.mask.path) else None for frame in scene.frames]
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
    if unfit := [path.name for path in there if path not in given]:
        warn(f"{root}: {len(unfit)} of {len(there)} masks fit no photo and are not used ({listed(unfit)})")
    bare = [photo.name for photo, mask in zip(photos, masks, strict=True) if mask is None]
    if given and bare:
        warn(f"{root}: {len(bare)} of {len(masks)} photos have no mask and count as they are ({listed(bare)})")
    return masks


def are_masks(names: Collection[str]) -> set[str]:
    """Those of a folder's names that are masks of other photos in it."""
    stems, every = {Path(name).stem for name in names}, set(names)
    ended = {name for name in names for end in ENDS if Path(name).stem.removesuffix(end) in stems - {Path(name).stem}}
    return ended | {name for name in names if Path(name).suffix == ".png" and Path(name).stem in every}


def _mask_of(photo: Path, root: Path, folders: dict[Path, None]) -> Mask | None:
    """The mask of a photo; folders of masks that there are are added to `folders`."""
    for path in _places(photo, root, folders):
        if is_there(path):
            return Mask(path, is_background=False)
    return Mask(photo, is_background=True, is_opacity=True) if is_transparent(photo) else None


def _places(photo: Path, root: Path, folders: dict[Path, None]) -> Iterator[Path]:
    """Where a photo's mask may lie."""
    for end in ENDS:
        yield find_photo(photo.parent, f"{photo.stem}{end}.png")
    yield photo.with_name(f"{photo.name}.png")
    for base in (base for base in photo.parents if base == root or root in base.parents):
        folder = next((found for name in FOLDERS if (found := find_folder(base, name))), None)
        if folder is None:
            continue
        folders[folder] = None
        parts = photo.relative_to(base).parts
        for tail in (PurePosixPath(*parts), PurePosixPath(*parts[1:])) if parts[1:] else (PurePosixPath(*parts),):
            yield find_photo(folder, f"{tail}.png")
            yield find_photo(folder, str(tail.with_suffix(".png")))
