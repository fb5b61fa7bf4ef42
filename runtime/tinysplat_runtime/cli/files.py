"""Files that commands are given, opened with the options that commands share."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..api import MAX_FILE_BYTES, Runtime
from ..container.layout import MAGIC, SUFFIX
from ..container.notes import NOTE_NAMES
from ..container.records import Limits
from ..errors import InputError, TinySplatError
from ..gaussian.gaussians import Gaussians
from ..graphs.providers import providers_of
from ..system.files import read_limited, write_atomically
from ..system.stopwatch import Stopwatch
from .outputs import STANDARD, is_standard


def file_limits(args: Namespace) -> Limits:
    """What `--max-pixels` and `--max-memory` allow."""
    default = Limits()
    return Limits(args.max_pixels or default.max_pixels, args.max_memory or default.max_memory_bytes)


def is_in_part(args: Namespace) -> bool:
    """Whether the file may end before its metadata says that it does."""
    return args.max_bytes is not None or bool(args.partial)


def limited_runtime(args: Namespace) -> Runtime:
    """A runtime with the options that commands share."""
    return Runtime(threads=args.threads, providers=providers_of(args.provider), limits=file_limits(args))


def decompress_named(runtime: Runtime, data: bytes, args: Namespace, watch: Stopwatch) -> Gaussians:
    """Gaussians of a .tsplat file's bytes; errors name `args.file`, and so does the line that says what is lost."""
    lost: list[str] | None = [] if args.partial else None
    try:
        gaussians = runtime.decompress(data, max_bytes=args.max_bytes, lost=lost, model=args.model, watch=watch)
    except TinySplatError as error:
        raise error.within(args.file) from None
    if lost:
        print(f"{args.file}: lost {len(lost)} of its planes: {', '.join(lost)}", file=sys.stderr)
    return gaussians


def load_any(args: Namespace, watch: Stopwatch) -> Gaussians:
    """The Gaussians of `args.file`, of any format that holds some; `-` is standard input."""
    data = sys.stdin.buffer.read(MAX_FILE_BYTES) if args.file == STANDARD else None
    if Path(args.file).suffix.lower() == SUFFIX or (data is not None and data.startswith(MAGIC)):
        data = read_limited(args.file, MAX_FILE_BYTES) if data is None else data
        return decompress_named(limited_runtime(args), data, args, watch)
    for option, value in (("--max-bytes", args.max_bytes), ("--partial", args.partial or None)):
        if value is not None:
            raise InputError(f"only .tsplat files can be decoded in part, not {args.file}", where=option)
    from ..formats.table import load_gaussians  # every format there is, which a .tsplat file is none of

    if data is None:
        return load_gaussians(args.file)
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"standard input{_suffix_of(data)}"
        copy.write_bytes(data)
        return load_gaussians(copy)


def _suffix_of(data: bytes) -> str:
    """The ending that a file of these bytes would have."""
    starts = {b"ply": ".ply", b"PK": ".npz", b"\x1f\x8b": ".spz", b"NGSP": ".spz", b"glTF": ".glb"}
    found = next((suffix for start, suffix in starts.items() if data.startswith(start)), None)
    if found is None and data[8:9] == b"{":
        found = ".safetensors"
    if found is None:
        accepted = ".tsplat, .npz, .safetensors, .ply, .spz or .glb"
        raise InputError(f"starts with {data[:4].hex(' ') or 'nothing'}, expected {accepted}", where="standard input")
    return found


def read_file(path: str) -> bytes:
    """A file's bytes, or those of standard input for `-`."""
    return sys.stdin.buffer.read(MAX_FILE_BYTES) if path == STANDARD else read_limited(path, MAX_FILE_BYTES)


def write_file(path: str, data: bytes) -> None:
    """Write a file, or to standard output."""
    if not is_standard(path):
        write_atomically(path, data)
        return
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()


def say(args: Namespace, text: str) -> None:
    """Print what a command has to say, unless `--quiet`; to standard error where the output is what goes to its own."""
    if not args.quiet:
        output = getattr(args, "output", None) or getattr(args, "html", None) or ""
        print(text, file=sys.stderr if is_standard(output) else sys.stdout)


def noted(args: Namespace, gaussians: Gaussians) -> Gaussians:
    """The Gaussians with what `--unit`, `--attribution` and `--licence` say, over what they said of themselves."""
    given = {name: getattr(args, name) for name in NOTE_NAMES if getattr(args, name) is not None}
    try:
        return gaussians.with_notes(replace(gaussians.notes, **given)) if given else gaussians
    except InputError as error:
        raise InputError(error.message, where=f"--{error.where}") from None


def grid_option(values: Sequence[int] | None) -> tuple[int, int, int] | None:
    """`--grid` as a shape."""
    if values is None:
        return None
    if len(values) != 3 or min(values) < 1:
        raise InputError(f"{','.join(map(str, values))}, expected V,H,W of 1 or more", where="--grid")
    return values[0], values[1], values[2]
