"""`tinysplat compare`: two results side by side, with maps of their error."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from tinysplat.measure.show.sheets import Sheet, gaussian_sheet, picture_sheet, result_sheets, write_sheet
from tinysplat.measure.show.tables import format_table, number
from tinysplat_runtime.api import load_gaussians
from tinysplat_runtime.cli.arguments import size
from tinysplat_runtime.container.layout import SUFFIX
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import endings
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.layouts import load_cameras
from tinysplat_runtime.system.files import write_atomically
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.progress import progress

HELP = "two results side by side, with maps of their error"
NEEDS = ("matplotlib", "PIL")

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
GAUSSIAN_SUFFIXES = (SUFFIX, *endings(written=False))


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "A and B are two pictures, two files of Gaussians, or two folders of `tinysplat eval --pictures`. Gaussians are"
        " rendered at the views of A and midway between neighbouring ones."
    )
    parser.add_argument("a", metavar="A", help=".tsplat, .ply or other Gaussians, .png, .jpg, or a folder of results")
    parser.add_argument("b", metavar="B", help="the same kind of thing as A")
    parser.add_argument("-o", "--output", default="comparison", metavar="FOLDER", help="default comparison")
    parser.add_argument("--cameras", metavar="cameras.json", help="where to look from; default: the views of A, or B")
    parser.add_argument("--size", type=size, metavar="WxH", help="size of rendered pictures; default: the cameras'")


def run(args: Namespace) -> None:
    """Write the sheets and `comparison.json`, print the figures."""
    sheets = _sheets(Path(args.a), Path(args.b), args.cameras, args.size)
    folder = Path(args.output)
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file, expected a folder", where=str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for sheet in progress(sheets, len(sheets), "sheets", quiet=args.quiet):
        paths = write_sheet(folder, sheet)
        entries.append(
            {"sheet": sheet.name, "files": [p.name for p in paths], "views": [r.scores() for r in sheet.rows]}
        )
    write_atomically(folder / "comparison.json", (json.dumps({"sheets": entries}, indent=1) + "\n").encode())
    if not args.quiet:
        print(_table(entries))
        written = sum(len(entry["files"]) for entry in entries)
        print(f"\n{written} picture{'s' * (written != 1)} in {folder}")


def _sheets(a: Path, b: Path, cameras: str | None, size: tuple[int, int] | None) -> list[Sheet]:
    kinds = [_kind(path) for path in (a, b)]
    if kinds[0] != kinds[1]:
        raise InputError(f"a {kinds[1]}, but {a} is a {kinds[0]}; expected two of a kind", where=str(b))
    if kinds[0] == "folder of results":
        return result_sheets(a, b)
    if kinds[0] == "picture":
        return [picture_sheet(a, b)]
    gaussians = (load_gaussians(a), load_gaussians(b))
    return [gaussian_sheet(gaussians, (a.name, b.name), _cameras(cameras, gaussians), size)]


def _kind(path: Path) -> str:
    if path.is_dir():
        return "folder of results"
    suffix = path.suffix.lower()
    if suffix in PICTURE_SUFFIXES:
        return "picture"
    if path.name.lower().endswith(GAUSSIAN_SUFFIXES):
        return "file of Gaussians"
    accepted = ", ".join((*GAUSSIAN_SUFFIXES, *PICTURE_SUFFIXES))
    raise InputError(f"'{suffix}', accepted are {accepted} and folders of results", where=str(path))


def _cameras(named: str | None, gaussians: tuple[Gaussians, Gaussians]) -> list[Camera]:
    cameras = load_cameras(named) if named else [*gaussians[0].cameras] or [*gaussians[1].cameras]
    if not cameras:
        raise InputError("neither file has cameras; give --cameras cameras.json", where="compare")
    return cameras


def _table(entries: list[JsonObject]) -> str:
    rows = [(entry["sheet"], view) for entry in entries for view in entry["views"]]
    columns = list(dict.fromkeys(key for _, view in rows for key in view if key != "view"))
    header = ["sheet", "view", *(column.replace("_", " ") for column in columns)]
    digits = [2 if column.startswith("psnr") else 4 for column in columns]
    lines = [
        [name, view["view"], *(number(view.get(c), d) for c, d in zip(columns, digits, strict=True))]
        for name, view in rows
    ]
    return format_table(header, lines)
