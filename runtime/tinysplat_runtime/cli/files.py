"""Files that commands are given, opened with the options that commands share."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..api import Runtime
from ..container.notes import NOTE_NAMES
from ..container.records import Limits
from ..errors import InputError, TinySplatError
from ..formats.table import load_gaussians
from ..gaussian.gaussians import Gaussians
from ..system.files import read_limited
from ..system.stopwatch import Stopwatch

MAX_FILE_BYTES = 1 << 31


def file_limits(args: Namespace) -> Limits:
    """What `--max-pixels` and `--max-memory` allow."""
    default = Limits()
    return Limits(args.max_pixels or default.max_pixels, args.max_memory or default.max_memory_bytes)


def is_in_part(args: Namespace) -> bool:
    """Whether the file may end before its metadata says that it does."""
    return args.max_bytes is not None or bool(args.partial)


def providers(args: Namespace) -> tuple[str, ...]:
    """`--provider` in onnxruntime's spelling, and the CPU behind it."""
    cpu = "CPUExecutionProvider"
    if not args.provider:
        return (cpu,)
    name = args.provider if args.provider.endswith("ExecutionProvider") else f"{args.provider}ExecutionProvider"
    return tuple(dict.fromkeys((name, cpu)))


def limited_runtime(args: Namespace) -> Runtime:
    """A runtime with the options that commands share."""
    return Runtime(threads=args.threads, providers=providers(args), limits=file_limits(args))


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
    """The Gaussians of `args.file`, of any format that holds some."""
    if Path(args.file).suffix.lower() == ".tsplat":
        return decompress_named(limited_runtime(args), read_limited(args.file, MAX_FILE_BYTES), args, watch)
    for option, value in (("--max-bytes", args.max_bytes), ("--partial", args.partial or None)):
        if value is not None:
            raise InputError(f"only .tsplat files can be decoded in part, not {args.file}", where=option)
    return load_gaussians(args.file)


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
