"""Names of outputs: which are files of this machine's, and which may be written."""

import os
import re
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from ..container.layout import SUFFIX
from ..errors import InputError

STANDARD = "-"
"""In place of a file's name: standard input or output."""


class Input(str):
    """Name of a file or folder that a command reads."""


class Output(str):
    """Name of a file, or of a folder, that a command writes."""


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
    for _, path in _names(args, Input):
        if _URL.match(path):
            raise InputError("a URL, expected a file or folder on this machine (`batch` takes URLs)", where=path)


def _names(args: Namespace, kind: type[str]) -> Iterator[tuple[str, str]]:
    """What a command line names of a kind, each with its option."""
    for name, given in vars(args).items():
        option = "-o" if name == "output" else f"--{name.replace('_', '-')}"
        yield from ((option, one) for one in (given if isinstance(given, list) else [given]) if isinstance(one, kind))


def check_outputs(args: Namespace) -> None:
    """Refuse outputs that are no files of this machine's, those that are there already without `--force`, and two that
    are one file, of which the other may also be an input.
    """
    example = f"scene{_EXAMPLES.get(args.command, SUFFIX)}"
    is_folder = args.command == "view" and args.files
    inputs, outputs = ([*_names(args, kind)] for kind in (Input, Output))
    for i, (option, path) in enumerate(outputs):
        others = outputs[:i] + ([] if option == "-o" else inputs)
        if same := next((one for _, one in others if os.path.realpath(one) == os.path.realpath(path)), None):
            raise InputError(f"{path}, the same file as {same}; expected another", where=option)
        if is_standard(path):
            continue
        if not path:
            raise InputError(f"an empty name, expected that of a file such as {example}", where=option)
        if _URL.match(path):
            raise InputError("a URL, expected a file's name on this machine (`batch` writes to URLs)", where=path)
        target = Path(path)
        if path.endswith(("/", "\\")) and not target.is_dir() and not is_folder:
            raise InputError(f"is the name of a folder, expected that of a file such as {target / example}", where=path)
        if option == "-o" and args.command == "encode" and target.suffix.lower() != SUFFIX and not target.is_dir():
            from ..formats.table import endings  # every format there is, of which most files are none

            if not path.lower().endswith(tuple(accepted := endings(written=True))):
                raise InputError(f"'{target.suffix}', expected {', '.join((SUFFIX, *accepted))}", where=path)
        if option == "-o" and args.command == CODED_BY and target.suffix.lower() != SUFFIX and not target.is_dir():
            fault = f"'{target.suffix}', expected {SUFFIX}; other formats: `tinysplat decode` or `convert` afterwards"
            raise InputError(fault, where=path)
        if args.command == "view" and not is_folder and target.suffix.lower() not in PAGES and not target.is_dir():
            raise InputError(f"'{target.suffix}', expected .html: {option} names a page", where=path)
        if is_folder and target.suffix.lower() in PAGES:
            raise InputError(f"the name of a page, expected that of a folder such as {target.stem}", where=path)
        if target.is_dir() and not is_folder:
            raise InputError(f"is a folder, expected the name of a file such as {target / example}", where=path)
        if not target.absolute().parent.is_dir():
            raise InputError(f"folder {target.parent} does not exist; create it first", where=path)
        if target.is_file() and not getattr(args, "force", False):
            raise InputError(f"exists; {option} names another, and --force overwrites it", where=path)
