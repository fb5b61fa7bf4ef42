"""`tinysplat poses`: photos without cameras, or a video, to a scene folder, by structure from motion with pycolmap."""

from __future__ import annotations

import math
import sys
import tempfile
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat.poses.copies import copies, encoded, upright_copies
from tinysplat.poses.folder import write_folder
from tinysplat.poses.frames import look_through
from tinysplat.poses.judging import Placement
from tinysplat.poses.level import upright
from tinysplat.poses.model import coloured_points, placed_photos
from tinysplat.poses.panoramas import Wedge, check_shape, check_whole, face, kept, says_panorama, side_of
from tinysplat.poses.placing import MASKS, NonePlacedError, place
from tinysplat.poses.still import still_masks
from tinysplat_runtime.cli.options import add_threads
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.level import Level
from tinysplat_runtime.render.panorama import FACES
from tinysplat_runtime.scene import heic, pillow
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.footage import SUFFIXES as VIDEOS
from tinysplat_runtime.scene.footage import open_video
from tinysplat_runtime.scene.images import NOT_READ, PHOTO_SUFFIXES, image_size, read_image, taken_with
from tinysplat_runtime.scene.intake.depths import observed_range
from tinysplat_runtime.scene.intake.masks import masks_of
from tinysplat_runtime.scene.intake.photos import own_photos
from tinysplat_runtime.scene.masks import Mask
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.spacing import Spacing
from tinysplat_runtime.system.evenly import evenly
from tinysplat_runtime.system.printable import printable
from tinysplat_runtime.system.progress import wipe
from tinysplat_runtime.system.voice import Voice

HELP = "camera poses of photos or a video, as a scene folder"
NEEDS = ("pycolmap",)

KINDS = ", ".join(VIDEOS)

ENOUGH = 2 / 3
"""Share of a video's frames, or of photos, that have to be placed."""

SPARED = 0.1
"""Of a video's frames, that may be missing before more are added."""

ROUNDS = 3
"""In which frames are placed, each with more of them."""

MOST_PANORAMAS, HALF = 32, 128
"""Frames of a 360° video where nobody says how many, six photos each; level of a mask from which on pixels count."""

MOST_NAMED = 6
"""Folders that are named where photos are in these."""

ASIDE = "walk sideways or around what you film, by a tenth of its distance and more, with the camera towards it"


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Finds where each photo was taken from, takes lens distortion out, and writes photos, cameras.json,"
        " transforms.json and COLMAP's text files. Of a video, sharp frames are chosen, apart by as much as the camera"
        " moved, and more where few of them can be placed. The world stands upright, with y down and the ground at 0;"
        " its unit is arbitrary. Photos that could not be placed are named on standard error."
    )
    parser.add_argument(
        "photos",
        metavar="PHOTOS",
        help=f"folder of photos (.jpg, .png, .heic, .webp, .tif) of one static place, or a video: {KINDS}",
    )
    parser.add_argument("-o", "--output", required=True, metavar="SCENE", help="folder to write, new or empty")
    parser.add_argument(
        "--360",
        dest="panorama",
        action="store_true",
        help="pictures twice as wide as high are 360° (equirectangular), also if files do not say so",
    )
    parser.add_argument(
        "--without",
        type=_part,
        action="append",
        default=[],
        metavar="A-B|down|up",
        help="leave out of 360° pictures: longitudes from A to B, degrees to the right of the middle, or a cube's face",
    )
    parser.add_argument("--frames", type=_count, metavar="N", help="of a video; default: by its movement, 16 to 64")
    add_threads(parser)


def _count(text: str) -> int:
    if not text.isdecimal() or not 2 <= int(text) <= 1000:
        raise ArgumentTypeError(f"'{text}', expected a whole number of 2 to 1000")
    return int(text)


def _part(text: str) -> Wedge | str:
    if text in FACES:
        return text
    first, dash, last = text.rpartition("-")
    try:
        wedge = Wedge(float(first), float(last))
    except ValueError:
        wedge = Wedge(math.nan, math.nan)
    if not (dash and -360 <= wedge.first < wedge.last <= 360 and wedge.last - wedge.first < 360):
        raise ArgumentTypeError(f"'{text}', expected degrees such as 150-210, or one of {', '.join(FACES)}")
    return wedge


def run(args: Namespace) -> None:
    """Place the photos, write the scene, say which are missing."""
    source, output = Path(args.photos), Path(args.output)
    is_video = source.suffix.lower() in VIDEOS and not source.is_dir()
    if args.frames is not None and not is_video:
        raise InputError(f"given with {source}, expected a video ({KINDS})", where="--frames")
    voice, found = Voice(args.quiet, shows_results=True), [] if is_video else _photo_names(source)
    is_panorama = _is_panorama([source] if is_video else [source / name for name in found], args)
    _check_output(output)
    with tempfile.TemporaryDirectory() as work:
        photos, masks = Path(work) / "photos", dict[str, Mask]()
        photos.mkdir()
        try:
            if is_panorama:
                names, masks, placement = _of_panoramas(source, found, photos, args, voice)
            elif is_video:
                names, masks, placement = _of_video(source, photos, args, voice)
            else:
                names = _copied(source, found, photos, voice)
                masks = _masks(source, names, photos) or _still(source, list(names), photos)
                lenses = {copy: taken_with(source / name) for copy, name in names.items()}
                if not any(said for lens in lenses.values() for said in lens):
                    lenses = {}
                if (count := len(set(lenses.values()))) > 1:
                    voice.say("notice", f"{count} lenses or zooms, as Exif says: each has a camera of its own", source)
                placement = place(photos, list(names), Path(work), args.threads or -1, lenses=lenses, told=voice)
                model = placement.model
                used = {image.camera_id for image in model.images.values() if image.has_pose}
                sizes = {(camera.width, camera.height) for camera in map(model.cameras.__getitem__, used)}
                if not lenses and len(used) > len(sizes):
                    _say(source, f"{len(used)} lenses or zooms, as the photos fit: each has a camera of its own")
            _check_placement(placement)
            if not (is_video or is_panorama):
                _check_enough(names, placement)
            cameras, (near, far), level = _write(output, photos, placement, masks, voice)
        except InputError as error:
            where = (error.where or str(source)).replace(str(photos), str(source))
            raise InputError(error.message, where=where) from None
    for line in _remarks(names, placement, "frame" if is_video else "photo"):
        _say(source, line)
    doubt = "" if level.is_sure else ", which is not sure"
    voice.say("notice", f"turned upright to ± {level.off:.1f}°{doubt}, from {level.evidence}", source)
    if near and far:
        said = Spacing.of(list(cameras.values()), near, far).said([names[name] for name in cameras])
        voice.say("notice", said, source)
    depths = "" if near is None or far is None else f", near {near:.4g}, far {far:.4g}"
    voice.done(f"{len(cameras)} photos{depths}; `tinysplat encode {output} -o F.tsplat` takes it", output)


def _say(where: Path, line: str) -> None:
    """What matters where nothing else is to be said, too."""
    wipe()
    print(printable(f"{where}: {line}"), file=sys.stderr)


def _write(
    output: Path, photos: Path, placement: Placement, masks: Mapping[str, Mask], voice: Voice
) -> tuple[dict[str, Camera], tuple[float | None, float | None], Level]:
    """Write the scene of photos that were placed, upright; their cameras by name, near and far, and what turned it."""
    (points, colours, errors), (entries, observations) = (
        coloured_points(placement.model),
        placed_photos(placement.model),
    )
    kept = np.array([entry["name"] in placement.right for entry in entries])
    w2c = np.array([entry["w2c"] for entry in entries])
    depths = observed_range(w2c, points, observations[kept[observations[:, 0]]])
    right, points, level = upright([entry for entry, is_kept in zip(entries, kept, strict=True) if is_kept], points)
    cameras = write_folder(output, photos, right, depths, (points, colours, errors), masks, voice)
    return cameras, depths, level


def _check_placement(placement: Placement) -> None:
    """InputError where what was found is no scene."""
    if len(placement.right) < 2:
        said = "the places that were found contradict the photos' own matches"
        raise InputError(f"{said}: take photos that overlap more, from places farther apart")
    within = f"most points are seen from directions within {placement.parallax:.1f}°"
    loose = _of(len(placement.uncertain), len(placement.right), "place", "uncertain")
    if placement.only_turns:
        raise InputError(
            f"as far as photos tell, the camera only turned or zoomed at one place: that shows no depth; {ASIDE}"
        )
    if not placement.shows_depth:
        raise InputError(f"the camera hardly moved, or only turned ({within}, {loose}): that shows no depth; {ASIDE}")


def _check_enough(names: Mapping[str, str], placement: Placement) -> None:
    """InputError where under two thirds of photos were placed, naming neighbours that are likely too far apart."""
    order = sorted(names, key=names.__getitem__)
    right = placement.right
    if len(right) >= ENOUGH * len(order):
        return
    gaps = [f"{names[a]} and {names[b]}" for a, b in pairwise(order) if not {a, b} <= right]
    more = f" and {len(gaps) - MOST_NAMED} more pairs" if len(gaps) > MOST_NAMED else ""
    said = f"only {len(right)} of {len(order)} photos could be placed"
    apart = f"too far apart, or too little alike, are {', '.join(gaps[:MOST_NAMED])}{more}"
    raise InputError(f"{said}; {apart}: take photos 3° to 10° apart between them; {ASIDE}")


def _of(count: int, all_of: int, what: str, how: str) -> str:
    """How many of so many things are how."""
    return f"{count} of {all_of} {what}{'s' if all_of > 1 else ''} {'is' if count == 1 else 'are'} {how}"


def _remarks(names: Mapping[str, str], placement: Placement, what: str) -> Iterator[str]:
    """What is to be said of photos, whose own names are given, that were left out or lie uncertain."""
    missing = [own for name, own in names.items() if name not in placement.right | placement.wrong]
    wrong = [own for name, own in names.items() if name in placement.wrong]
    if missing or wrong:
        why = []
        if missing:
            groups = ", ".join(map(str, placement.others[:4])) + (", …" if len(placement.others) > 4 else "")
            count = f"{len(placement.others)} groups" if len(placement.others) > 1 else "one group"
            joined = f" ({count} of them, of {groups}, fit each other alone)" if groups else ""
            why.append(f"{', '.join(missing)} could not be placed{joined}")
        if wrong:
            why.append(f"{', '.join(wrong)} lie elsewhere than their matches say")
        yield f"{_of(len(missing) + len(wrong), len(names), what, 'left out')}: {'; '.join(why)}"
    if placement.uncertain:
        said = _of(len(placement.uncertain), len(placement.right), "place", "uncertain")
        most = names[placement.uncertain[0]]
        yield f"{said}, {most} the most: step aside where you only turned, and take more photos"


def _still(source: Path, names: Sequence[str], photos: Path) -> dict[str, Mask]:
    """Masks of what stands still in all photos, for COLMAP beside their folder, too; says where that is."""
    masks, where = still_masks(photos, names, photos.with_name(MASKS))
    if masks:
        said = f"something stands still at one place of the picture ({where}) while all else moves"
        _say(source, f"{said}: a title, a logo or dirt; it is left out of matching, and masked in the scene")
    return masks


def _of_video(
    source: Path, photos: Path, args: Namespace, voice: Voice
) -> tuple[dict[str, str], dict[str, Mask], Placement]:
    """Frames that were written as photos, by name, masks of what stands still in them, and where they were taken; more
    of them where few could be placed.

    Raises:
        InputError: under two thirds could be placed.
    """
    video = open_video(source)
    walk = look_through(video, voice)
    if args.frames is not None and args.frames > len(walk.indices):
        raise InputError(f"{len(walk.indices)} frames, expected {args.frames} or more")
    names: dict[int, str] = {}
    found: list[tuple[dict[int, str], frozenset[str], Placement | None]] = []
    added = walk.chosen(args.frames)
    masks: dict[str, Mask] = {}
    while added and len(found) < ROUNDS:
        for index, picture in voice.progress("taking frames", video.frames(added), total=len(added)):
            names[index] = f"frame_{index:06}.jpg"
            (photos / names[index]).write_bytes(encoded(picture, names[index]))
        names = dict(sorted(names.items()))
        voice.say("notice", f"{len(names)} of {len(video.stamps)} frames, chosen for overlap and sharpness", source)
        if not found:
            masks = _still(source, list(names.values()), photos)
        elif masks:
            masks, _ = still_masks(photos, list(names.values()), photos.with_name(MASKS))
        try:
            frames = dict.fromkeys(names.values())  # of one lens
            placement = place(photos, list(frames), photos.parent, args.threads or -1, lenses=frames, told=voice)
        except NonePlacedError:
            placement = None
        right = placement.right if placement else frozenset()
        found.append((names, right, placement))
        missing = {index for index, name in names.items() if name not in right}
        is_enough = args.frames is not None or len(missing) <= SPARED * len(names)
        added = [] if is_enough else walk.between(list(names), missing)
    names, right, placement = max(found, key=lambda one: (len(one[1]) >= ENOUGH * len(one[0]), len(one[1])))
    if placement is not None and placement.only_turns:
        _check_placement(placement)
    if placement is None or len(right) < ENOUGH * len(names):
        times = (video.stamps - video.stamps[0]) * video.unit
        raise InputError(_unplaced([(float(times[i]), name in right) for i, name in names.items()]))
    return {name: name for name in names.values()}, masks, placement


def _is_panorama(paths: Sequence[Path], args: Namespace) -> bool:
    """Whether pictures are 360°, as they say or as is asked for.

    Raises:
        InputError: some are and others are not, or parts are to be left out of what is not.
    """
    said = [path for path in paths if says_panorama(path)]
    if said and len(said) < len(paths) and not args.panorama:
        fault = f"{len(said)} of {len(paths)} photos say that they are 360°"
        raise InputError(
            f"{fault}; expected all or none: put them into folders of their own", where=str(said[0].parent)
        )
    if args.panorama or said:
        return True
    if all(_is_twice_as_wide(path) for path in paths):
        _say(paths[0], "twice as wide as high; if that is 360°, --360 says so")
    if args.without:
        raise InputError("given with pictures that do not say that they are 360°; --360 does", where="--without")
    return False


def _is_twice_as_wide(path: Path) -> bool:
    if path.suffix.lower() in VIDEOS:
        video = open_video(path)
        return video.width == 2 * video.height
    height, width = image_size(path)
    return width == 2 * height


def _of_panoramas(
    source: Path, found: Sequence[str], photos: Path, args: Namespace, voice: Voice
) -> tuple[dict[str, str], dict[str, Mask], Placement]:
    """Faces of 360° pictures that were written as photos, by name, their masks, and where they were taken.

    Raises:
        InputError: pictures of another shape, or under two thirds could be placed.
    """
    wedges = [part for part in args.without if isinstance(part, Wedge)]
    faces = {name: turn for name, turn in FACES.items() if name not in args.without}
    if not any(abs(turn[2][1]) < 0.5 for turn in faces.values()):
        raise InputError("every level face is left out, expected one or more", where="--without")
    names: dict[str, str] = {}
    masks: dict[str, Mask] = {}
    for face_name in faces:
        for folder in (photos, photos.with_name(MASKS)):
            (folder / face_name).mkdir(parents=True)
    size: tuple[int, int] | None = None
    for own, picture, known in _panoramas(source, found, args, voice):
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
    placement = place(photos, list(names), photos.parent, args.threads or -1, rig=rig, told=voice)
    if len(placement.right) < ENOUGH * len(names):
        raise InputError(f"only {len(placement.right)} of {len(names)} faces of 360° pictures could be placed; {ASIDE}")
    return {name: f"{own} ({name.partition('/')[0]})" for name, own in names.items()}, masks, placement


def _panoramas(
    source: Path, found: Sequence[str], args: Namespace, voice: Voice
) -> Iterator[tuple[str, NDArray, NDArray | None]]:
    """Names of 360° pictures, the pictures, and (H, W) uint8, 255 where they count, None where all of one does."""
    if not found:
        video = open_video(source)
        check_shape(video.height, video.width, str(source))
        chosen = look_through(video, voice).chosen(args.frames)
        if args.frames is None and len(chosen) > MOST_PANORAMAS:
            chosen = [chosen[i] for i in evenly(len(chosen), MOST_PANORAMAS)]
        for index, picture in voice.progress("taking frames", video.frames(chosen), total=len(chosen)):
            yield f"frame_{index:06}.jpg", picture, None
        return
    for name in found:
        check_whole(source / name)
        height, width = image_size(source / name)
        check_shape(height, width, str(source / name))
    twins = copies(source, found)
    own = [name for name in found if name not in twins]
    masks = masks_of([source / name for name in own], source.parent)
    for name, mask in voice.progress("cutting faces", list(zip(own, masks, strict=True))):
        picture = read_image(source / name)
        yield name, picture, None if mask is None else mask.kept(*picture.shape[:2])


def _unplaced(frames: Sequence[tuple[float, bool]]) -> str:
    """What to film where few frames could be placed.

    Args:
        frames: when each is shown, seconds, and whether it was placed.
    """
    runs = [(is_placed, [time for time, _ in run]) for is_placed, run in groupby(frames, key=lambda frame: frame[1])]
    longest = max((times for is_placed, times in runs if not is_placed), key=lambda times: times[-1] - times[0])
    count = sum(is_placed for _, is_placed in frames)
    span = f"none from {longest[0]:.1f} s to {longest[-1]:.1f} s" if longest[0] < longest[-1] else "one here and there"
    said = f"only {count} of {len(frames)} frames could be placed, {span}"
    return f"{said}: film slowly, in good light, what has texture; {ASIDE}"


def _copied(source: Path, found: Sequence[str], photos: Path, voice: Voice) -> dict[str, str]:
    """Copy photos that differ into a folder, upright; their own names by what they are called there, in order."""
    twins = copies(source, found)
    if len(twins) + 1 == len(found):
        raise InputError(f"{len(found)} copies of one photo, expected 2 photos or more")
    if twins:
        twin, first = next(iter(twins.items()))
        more = f"; so are {len(twins) - 1} more copies" if len(twins) > 1 else ""
        _say(source, f"{twin} is the very file {first} and is left out{more}")
    kept = [name for name in found if name not in twins]
    called, turned = upright_copies(source, kept, photos, voice)
    if foreign := [name for name, copy in called.items() if Path(copy).suffix != Path(name).suffix.lower()]:
        voice.say("notice", f"{len(foreign)} of {len(kept)} photos ({_kinds(foreign)}) become JPEG", source)
    if turned:
        voice.say("notice", f"{turned} of {len(kept)} photos turned as their Exif orientation says", source)
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


def _photo_names(folder: Path) -> list[str]:
    """Names of the photos in a folder; says which cannot be read here, and where photos are if it has none."""
    if not folder.is_dir():
        fault = "no such folder" if not folder.exists() else f"a file, expected a folder or a video ({KINDS})"
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
        _say(folder, f"{line}, now they are left out")
    return readable


def _why_unread(name: str) -> str:
    """What reads a photo that is not read here; nothing where it is."""
    kind = Path(name).suffix.lower()
    for reader in (heic, pillow):
        if kind in reader.SUFFIXES and not reader.is_installed():
            return f"{reader.INSTALL} reads them"
    return "convert them to JPEG first" if kind in NOT_READ else ""


def _kinds(names: Sequence[str]) -> str:
    counts = Counter(Path(name).suffix.lower() for name in names)
    return ", ".join(f"{count} {kind}" for kind, count in counts.items())


def _check_output(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("exists and is not an empty folder", where=str(folder))
    if not folder.resolve().parent.is_dir():
        raise InputError(f"folder {folder.parent} does not exist; create it first", where=str(folder))
