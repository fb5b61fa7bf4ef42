"""`tinysplat poses`: photos without cameras, or a video, to a scene folder, by structure from motion with pycolmap."""

from __future__ import annotations

import json
import sys
import tempfile
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path

import numpy as np

from tinysplat.poses.folder import write_folder
from tinysplat.poses.frames import choose_frames
from tinysplat.poses.placing import coloured_points, copies, encoded, place, upright_copies
from tinysplat_runtime.cli.options import add_threads
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.footage import SUFFIXES as VIDEOS
from tinysplat_runtime.scene.footage import open_video
from tinysplat_runtime.scene.images import PHOTO_SUFFIXES
from tinysplat_runtime.scene.intake.colmap_worker import model_arrays
from tinysplat_runtime.scene.intake.depths import observed_range
from tinysplat_runtime.system.printable import printable
from tinysplat_runtime.system.progress import progress

HELP = "camera poses of photos or a video, as a scene folder"
NEEDS = ("pycolmap",)

KINDS = ", ".join(VIDEOS)


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Finds where each photo was taken from, takes lens distortion out, and writes photos, cameras.json,"
        " transforms.json and COLMAP's text files. Of a video, sharp frames are chosen, apart by as much as the camera"
        " moved. The scene's unit is arbitrary. Photos that could not be placed are named on standard error."
    )
    parser.add_argument(
        "photos", metavar="PHOTOS", help=f"folder of .jpg and .png photos of one static place, or a video: {KINDS}"
    )
    parser.add_argument("-o", "--output", required=True, metavar="SCENE", help="folder to write, new or empty")
    parser.add_argument("--frames", type=_count, metavar="N", help="of a video; default: by its movement, 8 to 64")
    add_threads(parser)


def _count(text: str) -> int:
    if not text.isdecimal() or not 2 <= int(text) <= 1000:
        raise ArgumentTypeError(f"'{text}', expected a whole number of 2 to 1000")
    return int(text)


def run(args: Namespace) -> None:
    """Place the photos, write the scene, say which are missing."""
    source, output = Path(args.photos), Path(args.output)
    is_video = source.suffix.lower() in VIDEOS and not source.is_dir()
    if args.frames is not None and not is_video:
        raise InputError(f"given with {source}, expected a video ({KINDS})", where="--frames")
    names = [] if is_video else _photo_names(source)
    _check_output(output)
    with tempfile.TemporaryDirectory() as work:
        photos = Path(work) / "photos"
        photos.mkdir()
        if is_video:
            names = _frames(source, photos, args.frames, quiet=args.quiet)
        else:
            if twins := copies(source, names):
                if len(twins) + 1 == len(names):
                    said = f"{len(names)} copies of one photo, expected 2 photos or more"
                    raise InputError(said, where=str(source))
                twin, first = next(iter(twins.items()))
                more = f", nor {len(twins) - 1} more copies" if len(twins) > 1 else ""
                print(printable(f"{source}: {twin} is the very file {first} and is left out{more}"), file=sys.stderr)
                names = [name for name in names if name not in twins]
            turned = upright_copies(source, names, photos)
            if turned and not args.quiet:
                said = f"{len(turned)} of {len(names)} photos turned as their Exif orientation says"
                print(f"{source}: {said}", file=sys.stderr)
        try:
            placement = place(photos, names, Path(work), args.threads or -1, quiet=args.quiet)
        except InputError as error:
            raise InputError(error.message, where=str(source)) from None
        model = placement.model
        arrays = model_arrays(model, {})
        entries = json.loads(arrays["entries"].tobytes())
        kept = np.array([entry["name"] not in placement.wrong for entry in entries])
        if kept.sum() < 2:
            said = "the places that were found contradict the photos' own matches"
            raise InputError(f"{said}: take photos that overlap more, from places farther apart", where=str(source))
        w2c, observations = np.array([entry["w2c"] for entry in entries]), arrays["observations"]
        near, far = observed_range(w2c, arrays["points"], observations[kept[observations[:, 0]]])
        right = [entry for entry, is_kept in zip(entries, kept, strict=True) if is_kept]
        placed = write_folder(output, photos, right, (near, far), coloured_points(model), quiet=args.quiet)
    missing = sorted(set(names) - set(placed))
    if missing:
        what = "frames" if is_video else "photos"
        said = f"{source}: {len(missing)} of {len(names)} {what} could not be placed: {', '.join(missing)}"
        print(printable(said), file=sys.stderr)
    if placement.wrong:
        said = f"{len(placement.wrong)} of them lie elsewhere than their matches say, and are left out"
        print(f"{source}: {said}", file=sys.stderr)
    if placement.others:
        sizes = ", ".join(map(str, placement.others[:4])) + (", …" if len(placement.others) > 4 else "")
        print(
            f"{source}: {len(placement.others)} further groups, of {sizes} photos, do not join these", file=sys.stderr
        )
    if placement.uncertain:
        said = f"{len(placement.uncertain)} of {len(placed)} places are uncertain, {placement.uncertain[0]} the most"
        print(printable(f"{source}: {said}: step aside where you only turned, and take more photos"), file=sys.stderr)
    if not args.quiet:
        depths = "" if near is None or far is None else f", near {near:.4g}, far {far:.4g}"
        print(f"{output}: {len(placed)} photos{depths}; `tinysplat encode {output} -o F.tsplat` takes it")


def _frames(source: Path, photos: Path, count: int | None, *, quiet: bool) -> list[str]:
    """Write chosen frames of a video as photos; names end in the frame's number."""
    video = open_video(source)
    chosen = choose_frames(video, count, quiet=quiet)
    if not quiet:
        said = f"{len(chosen)} of {len(video.stamps)} frames, the sharpest of each step of the camera's way"
        print(f"{source}: {said}", file=sys.stderr)
    names = []
    for index, picture in progress(video.frames(chosen), len(chosen), "taking frames", quiet=quiet):
        names.append(f"frame_{index:06}.jpg")
        (photos / names[-1]).write_bytes(encoded(picture, names[-1]))
    return names


def _photo_names(folder: Path) -> list[str]:
    if not folder.is_dir():
        fault = "no such folder" if not folder.exists() else f"a file, expected a folder or a video ({KINDS})"
        raise InputError(fault, where=str(folder))
    names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in PHOTO_SUFFIXES)
    heic = [path.name for path in folder.iterdir() if path.suffix.lower() in (".heic", ".heif")]
    if heic and len(names) < 2:
        advice = f"`heif-convert {heic[0]} {Path(heic[0]).stem}.jpg`, or a phone's `most compatible` format"
        raise InputError(f"{len(heic)} HEIC photos, expected JPEG or PNG: {advice}", where=str(folder))
    if len(names) < 2:
        raise InputError(f"{len(names)} photos ({', '.join(PHOTO_SUFFIXES)}), expected 2 or more", where=str(folder))
    return names


def _check_output(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("exists and is not an empty folder", where=str(folder))
    if not folder.resolve().parent.is_dir():
        raise InputError(f"folder {folder.parent} does not exist; create it first", where=str(folder))
