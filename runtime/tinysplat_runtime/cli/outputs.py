"""Names of outputs: which are files of this machine's, and which may be written."""

from __future__ import annotations

import re
from argparse import Namespace
from pathlib import Path

from ..container.layout import SUFFIX
from ..errors import InputError

STANDARD = "-"
"""In place of a file's name: standard input or output."""

OUTPUTS = {"output": "-o", "html": "--html", "report": "--report", "save_gaussians": "--save-gaussians"}

INPUTS = ("file", "files", "scene", "gaussians", "photos", "poses", "cameras", "like", "camera")
"""Options and words that name something to read, where they are texts."""

_URL = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+://")

PAGES = (".html", ".htm")

_EXAMPLES = {"view": ".html", "render": ".png", "decode": ".spz", "convert": ".spz"}
"""Endings of what further commands may write, for messages."""

CODED_BY = "compress"
"""The command that writes .tsplat files alone."""


def is_standard(path: str) -> bool:
    """Whether a name of an output stands for standard output: `-`, or with a format `-.ply`."""
    return path == STANDARD or path.startswith(f"{STANDARD}.")


def made_folder(path: str) -> Path:
    """A folder for what a command writes, made where there is none."""
    folder = Path(path)
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file, expected a folder", where=path)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def check_inputs(args: Namespace) -> None:
    """Refuse URLs: paths that become `Path`s lose a slash, and nobody finds them in a message."""
    for name in INPUTS:
        given = getattr(args, name, None) or ()
        for path in [given] if isinstance(given, str) else given:
            if _URL.match(path):
                raise InputError("a URL, expected a file or folder on this machine (`batch` takes URLs)", where=path)


def check_outputs(args: Namespace) -> None:
    """Refuse outputs that are no files of this machine's, and those that are there already without `--force`."""
    example = f"scene{_EXAMPLES.get(args.command, SUFFIX)}"
    is_folder = getattr(args, "as_files", False)
    for name, option in OUTPUTS.items():
        path = getattr(args, name, None)
        if path is None or is_standard(path):
            continue
        if not path:
            raise InputError(f"an empty name, expected that of a file such as {example}", where=option)
        if _URL.match(path):
            raise InputError("a URL, expected a file's name on this machine (`batch` writes to URLs)", where=path)
        target = Path(path)
        if path.endswith(("/", "\\")) and not target.is_dir() and not is_folder:
            raise InputError(f"is the name of a folder, expected that of a file such as {target / example}", where=path)
        if name == "output" and args.command == "encode" and target.suffix.lower() != SUFFIX and not target.is_dir():
            from ..formats.table import find_format  # every format there is, of which most files are none

            find_format(path, written=True)
        if name == "output" and args.command == CODED_BY and target.suffix.lower() != SUFFIX and not target.is_dir():
            fault = f"'{target.suffix}', expected {SUFFIX}; other formats: `tinysplat decode` or `convert` afterwards"
            raise InputError(fault, where=path)
        if args.command == "view" and not is_folder and target.suffix.lower() not in PAGES and not target.is_dir():
            raise InputError(f"'{target.suffix}', expected .html: {option} names a page", where=path)
        if target.is_dir() and not is_folder:
            raise InputError(f"is a folder, expected the name of a file such as {target / example}", where=path)
        if not target.absolute().parent.is_dir():
            raise InputError(f"folder {target.parent} does not exist; create it first", where=path)
        if target.is_file() and not getattr(args, "force", False):
            raise InputError(f"exists; {option} names another, and --force overwrites it", where=path)
