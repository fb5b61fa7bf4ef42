"""Photos of a folder: which can be read, upright copies of those that differ, their masks, lenses and places."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tinysplat_runtime.errors import InputError, warn
from tinysplat_runtime.scene import exif, heic, pillow
from tinysplat_runtime.scene.footage import SUFFIXES as VIDEOS
from tinysplat_runtime.scene.images import NOT_READ, PHOTO_SUFFIXES, exif_of, image_size
from tinysplat_runtime.scene.intake.masks import masks_of
from tinysplat_runtime.scene.intake.photos import own_photos
from tinysplat_runtime.scene.masks import Mask
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.system.told import Told

from .copies import copies, upright_copies
from .placing import MASKS, Taken, place
from .remarks import check_enough, check_placement
from .request import PosesRequest
from .still import masked_still

MOST_NAMED = 6
"""Folders that are named where photos are in these."""


def taken_as_photos(request: PosesRequest, found: Sequence[str], photos: Path, told: Told) -> Taken:
    """Photos of a folder, by their names there, copied to `photos`, and where they were taken.

    Raises:
        InputError: under two thirds could be placed, or what was found is no scene.
    """
    source = Path(request.photos)
    names = _copied(source, found, photos, told)
    masks = _masks(source, names, photos) or masked_still(source, list(names), photos)
    lenses, gravity = dict[str, tuple[object, ...]](), dict[str, tuple[float, float, float]]()
    for copy, name in names.items():
        said = exif_of(source / name)
        lenses[copy] = exif.taken_with(said)
        if (stated := exif.gravity(said)) is not None:
            gravity[copy] = stated
    if not any(said for lens in lenses.values() for said in lens):
        lenses = {}
    if (count := len(set(lenses.values()))) > 1:
        told.say("notice", f"{count} lenses or zooms, as Exif says: each has a camera of its own", source)
    placement = place(photos, list(names), photos.parent, request.threads or -1, lenses=lenses, told=told)
    model = placement.model
    used = {image.camera_id for image in model.images.values() if image.has_pose}
    sizes = {(camera.width, camera.height) for camera in map(model.cameras.__getitem__, used)}
    if not lenses and len(used) > len(sizes):
        warn(f"{source}: {len(used)} lenses or zooms, as the photos fit: each has a camera of its own")
    check_placement(placement)
    check_enough(names, placement)
    return Taken(names, masks, placement, gravity)


def photos_at(path: Path) -> Path:
    """A folder's `images/`, where photos are only there, as many programs keep them; else the path as it is."""
    inside = path / "images"
    return inside if inside.is_dir() and own_photos(inside) and not own_photos(path) else path


def photo_names(folder: Path) -> list[str]:
    """Names of the photos in a folder; says which cannot be read here, and where photos are if it has none."""
    if not folder.is_dir():
        fault = (
            "no such folder" if not folder.exists() else f"a file, expected a folder or a video ({', '.join(VIDEOS)})"
        )
        raise InputError(fault, where=str(folder))
    others = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in NOT_READ and path.name[0] != "."]
    left: dict[str, list[str]] = {"": []}
    for name in [path.name for path in (*own_photos(folder), *others)]:
        left.setdefault(_why_unread(name), []).append(name)
    count = sum(map(len, left.values()))
    readable = left.pop("")
    said = [f"{len(names)} of {count} photos ({_kinds(names)}) are not read; {how}" for how, names in left.items()]
    if len(readable) < 2:
        inside = [path for pattern in ("*", "*/*") for path in sorted(folder.glob(pattern)) if path.is_dir()]
        said += [f"{path.relative_to(folder)}/ has {n}" for path in inside if (n := len(own_photos(path)))][:MOST_NAMED]
        fault = f"{len(readable)} photos in it ({', '.join(PHOTO_SUFFIXES)}), expected 2 or more"
        raise InputError("; ".join([fault, *said]), where=str(folder))
    for line in said:
        warn(f"{folder}: {line}, now they are left out")
    return readable


def _why_unread(name: str) -> str:
    """What reads a photo that is not read here; nothing where it is."""
    kind = Path(name).suffix.lower()
    for reader in (heic, pillow):
        if kind in reader.SUFFIXES and not reader.is_installed():
            return f"{reader.INSTALL} reads them"
    return "convert them to JPEG first" if kind in NOT_READ else ""


def _copied(source: Path, found: Sequence[str], photos: Path, told: Told) -> dict[str, str]:
    """Copy photos that differ into a folder, upright; their own names by what they are called there, in order."""
    twins = copies(source, found)
    if len(twins) + 1 == len(found):
        raise InputError(f"{len(found)} copies of one photo, expected 2 photos or more")
    if twins:
        twin, first = next(iter(twins.items()))
        more = f"; so are {len(twins) - 1} more copies" if len(twins) > 1 else ""
        warn(f"{source}: {twin} is the very file {first} and is left out{more}")
    kept = [name for name in found if name not in twins]
    called, turned = upright_copies(source, kept, photos, told)
    if foreign := [name for name, copy in called.items() if Path(copy).suffix != Path(name).suffix.lower()]:
        told.say("notice", f"{len(foreign)} of {len(kept)} photos ({_kinds(foreign)}) become JPEG", source)
    if turned:
        told.say("notice", f"{turned} of {len(kept)} photos turned as their Exif orientation says", source)
    return {copy: name for name, copy in called.items()}


def _masks(source: Path, names: Mapping[str, str], photos: Path) -> dict[str, Mask]:
    """Masks of photos by what these are called in `photos`, for COLMAP beside that folder, too."""
    found = masks_of([source / own for own in names.values()], source.parent)
    masks = {copy: mask for copy, mask in zip(names, found, strict=True) if mask is not None}
    if masks:  # COLMAP then wants one of every photo
        folder = photos.with_name(MASKS)
        folder.mkdir()
        for copy in names:
            size = image_size(photos / copy)
            kept = masks[copy].kept(*size) if copy in masks else np.full(size, 255, np.uint8)
            write_png(folder / f"{copy}.png", kept)
    return masks


def _kinds(names: Sequence[str]) -> str:
    counts = Counter(Path(name).suffix.lower() for name in names)
    return ", ".join(f"{count} {kind}" for kind, count in counts.items())
