"""360° pictures as photos: each is cut into faces of a cube, which were taken at one place (`panoramas.py`)."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError, warn
from tinysplat_runtime.render.panorama import FACES
from tinysplat_runtime.scene.footage import SUFFIXES as VIDEOS
from tinysplat_runtime.scene.footage import open_video
from tinysplat_runtime.scene.images import image_size, read_image
from tinysplat_runtime.scene.intake.masks import masks_of
from tinysplat_runtime.scene.masks import Mask
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.system.evenly import evenly
from tinysplat_runtime.system.told import Told

from .copies import copies, encoded
from .frames import look_through
from .panoramas import Wedge, check_shape, check_whole, face, kept, says_panorama, side_of
from .placing import MASKS, Taken, place
from .remarks import ASIDE, ENOUGH, check_placement
from .request import PosesRequest

MOST_PANORAMAS, HALF = 32, 128
"""Frames of a 360° video where nobody says how many, six photos each; level of a mask from which on pixels count."""


def is_panorama(request: PosesRequest, paths: Sequence[Path]) -> bool:
    """Whether pictures are 360°, as they say or as is asked for.

    Raises:
        InputError: some are and others are not, or parts are to be left out of what is not.
    """
    said = [path for path in paths if says_panorama(path)]
    if said and len(said) < len(paths) and not request.panorama:
        fault = f"{len(said)} of {len(paths)} photos say that they are 360°"
        raise InputError(
            f"{fault}; expected all or none: put them into folders of their own", where=str(said[0].parent)
        )
    if request.panorama or said:
        return True
    if all(_is_twice_as_wide(path) for path in paths):
        warn(f"{paths[0]}: twice as wide as high; if that is 360°, --360 says so")
    if request.without:
        raise InputError("given with pictures that do not say that they are 360°; --360 does", where="without")
    return False


def _is_twice_as_wide(path: Path) -> bool:
    if path.suffix.lower() in VIDEOS:
        video = open_video(path)
        return video.width == 2 * video.height
    height, width = image_size(path)
    return width == 2 * height


def taken_as_faces(request: PosesRequest, found: Sequence[str], photos: Path, told: Told) -> Taken:
    """Faces of 360° pictures, written to `photos`, and where they were taken; without names, of a video's frames.

    Raises:
        InputError: pictures of another shape, under two thirds could be placed, or what was found is no scene.
    """
    wedges = [part for part in request.without if isinstance(part, Wedge)]
    faces = {name: turn for name, turn in FACES.items() if name not in request.without}
    if not any(abs(turn[2][1]) < 0.5 for turn in faces.values()):
        raise InputError("every level face is left out, expected one or more", where="without")
    names: dict[str, str] = {}
    masks: dict[str, Mask] = {}
    for face_name in faces:
        for folder in (photos, photos.with_name(MASKS)):
            (folder / face_name).mkdir(parents=True)
    size: tuple[int, int] | None = None
    for own, picture, known in _panoramas(request, found, told):
        height, width = picture.shape[:2]
        check_shape(height, width, own)
        size = size or (height, width)
        if (height, width) != size:
            raise InputError(f"{width}x{height} pixels, expected {size[1]}x{size[0]} as the first has", where=own)
        for face_name in faces:
            side, name = side_of(height), f"{face_name}/{Path(own).stem}.jpg"
            counts = kept(face_name, side, wedges)
            if known is not None:
                counts &= face(np.repeat(known[..., None], 3, axis=2), face_name, side)[..., 0] >= HALF
            if not counts.any():
                continue
            names[name] = own
            (photos / name).write_bytes(encoded(face(picture, face_name, side), name))
            mask = photos.with_name(MASKS) / f"{name}.png"
            write_png(mask, counts.astype(np.float32))
            if not counts.all():
                masks[name] = Mask(mask, is_background=False)
    first = next(iter(faces.values()))
    rig = {name: turn @ first.T for name, turn in faces.items()}
    placement = place(photos, list(names), photos.parent, request.threads or -1, rig=rig, told=told)
    if len(placement.right) < ENOUGH * len(names):
        raise InputError(f"only {len(placement.right)} of {len(names)} faces of 360° pictures could be placed; {ASIDE}")
    check_placement(placement)
    return Taken({name: f"{own} ({name.partition('/')[0]})" for name, own in names.items()}, masks, placement)


def _panoramas(
    request: PosesRequest, found: Sequence[str], told: Told
) -> Iterator[tuple[str, NDArray, NDArray | None]]:
    """Names of 360° pictures, the pictures, and (H, W) uint8, 255 where they count, None where all of one does."""
    source = Path(request.photos)
    if not found:
        video = open_video(source)
        check_shape(video.height, video.width, str(source))
        chosen = look_through(video, told).chosen(request.frames)
        if request.frames is None and len(chosen) > MOST_PANORAMAS:
            chosen = [chosen[i] for i in evenly(len(chosen), MOST_PANORAMAS)]
        for index, picture in told.progress("taking frames", video.frames(chosen), total=len(chosen)):
            yield f"frame_{index:06}.jpg", picture, None
        return
    for name in found:
        check_whole(source / name)
        height, width = image_size(source / name)
        check_shape(height, width, str(source / name))
    twins = copies(source, found)
    own = [name for name in found if name not in twins]
    masks = masks_of([source / name for name in own], source.parent)
    for name, mask in told.progress("cutting faces", list(zip(own, masks, strict=True))):
        picture = read_image(source / name)
        yield name, picture, None if mask is None else mask.kept(*picture.shape[:2])
