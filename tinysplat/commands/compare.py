"""`tinysplat compare`: two results side by side, with maps of their error."""

import json
from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from pathlib import Path

from tinysplat.measure.show.sheets import MOST_PIXELS, Sheet, gaussian_sheet, picture_sheet, write_sheet
from tinysplat.measure.show.tables import format_table, number
from tinysplat_runtime.api import Runtime, load_gaussians
from tinysplat_runtime.cli.asks import Quiet
from tinysplat_runtime.cli.options import add_options, asked
from tinysplat_runtime.cli.outputs import made_folder
from tinysplat_runtime.container.layout import MAX_FILE_BYTES, SUFFIX
from tinysplat_runtime.errors import InputError, within
from tinysplat_runtime.formats.table import endings
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.layouts import load_cameras
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.files import read_limited, write_atomically
from tinysplat_runtime.system.options import REQUIRED, option
from tinysplat_runtime.system.progress import wipe
from tinysplat_runtime.system.told import Told

HELP = "two results side by side, with maps of their error"
NEEDS = ("matplotlib", "PIL")

STEPS = [("drawing", 6.0), ("writing sheets", 3.0), ("measuring", 2.0)]
"""And what each is likely to take against the others."""

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
GAUSSIAN_SUFFIXES = (SUFFIX, *endings(written=False))


@dataclass(frozen=True, kw_only=True)
class Compare(Quiet):
    """What the command asks for."""

    a: str = option(
        kinds.path, REQUIRED, is_bare=True, metavar="A", help=".tsplat, .ply or other Gaussians, .png, .jpg"
    )
    b: str = option(kinds.path, REQUIRED, is_bare=True, metavar="B", help="the same kind of thing as A")
    output: str = option(kinds.path, "comparison", short="o", metavar="FOLDER", help="default comparison")
    cameras: str | None = option(
        kinds.path, metavar="cameras.json", help="where to look from; default: the views of A, or B"
    )
    size: tuple[int, int] | None = option(
        kinds.size,
        metavar="WxH",
        help=f"size of rendered pictures; default: the cameras', but at most {MOST_PIXELS} pixels across",
    )


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "A and B are two pictures or two files of Gaussians, which are rendered at up to 12 of the views of A and"
        " midway between neighbouring ones."
    )
    add_options(parser, Compare)


def run(args: Namespace) -> None:
    """Write the sheet and `comparison.json`, print the figures."""
    own = asked(args, Compare)
    voice = own.voice
    voice.plan(STEPS)
    sheet = _sheet(Path(own.a), Path(own.b), own.cameras, own.size, voice)
    folder = made_folder(own.output)
    paths = write_sheet(folder, sheet, voice)
    views = [row.scores() for row in voice.progress("measuring", sheet.rows)]
    found = {"files": [path.name for path in paths], "views": views}
    write_atomically(folder / "comparison.json", (json.dumps(found, indent=1) + "\n").encode())
    if not own.quiet:
        rows = [(view["view"], number(view["psnr_b_to_a"], 2), number(view["ssim_b_to_a"], 4)) for view in views]
        wipe()
        print(format_table(["view", "PSNR", "SSIM"], rows))
        print(f"\n{len(paths)} picture{'s' * (len(paths) != 1)} in {folder}")


def _sheet(a: Path, b: Path, cameras: str | None, size: tuple[int, int] | None, told: Told) -> Sheet:
    kinds = [_kind(path) for path in (a, b)]
    if kinds[0] != kinds[1]:
        raise InputError(f"a {kinds[1]}, but {a} is a {kinds[0]}; expected two of a kind", where=str(b))
    if kinds[0] == "picture":
        return picture_sheet(a, b)
    runtime = Runtime(told=told)
    gaussians = _loaded(a, runtime), _loaded(b, runtime)
    return gaussian_sheet(gaussians, (a.name, b.name), _cameras(cameras, gaussians), size, told)


def _loaded(path: Path, runtime: Runtime) -> Gaussians:
    if path.suffix.lower() != SUFFIX:
        return load_gaussians(path)
    with within(str(path)):
        return runtime.decompress(read_limited(path, MAX_FILE_BYTES))


def _kind(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix in PICTURE_SUFFIXES:
        return "picture"
    if path.name.lower().endswith(GAUSSIAN_SUFFIXES):
        return "file of Gaussians"
    accepted = ", ".join((*GAUSSIAN_SUFFIXES, *PICTURE_SUFFIXES))
    raise InputError(f"'{suffix}', accepted are {accepted}", where=str(path))


def _cameras(named: str | None, gaussians: tuple[Gaussians, Gaussians]) -> list[Camera]:
    cameras = load_cameras(named) if named else [*gaussians[0].cameras] or [*gaussians[1].cameras]
    if not cameras:
        raise InputError("neither file has cameras; give --cameras cameras.json", where="compare")
    return cameras
