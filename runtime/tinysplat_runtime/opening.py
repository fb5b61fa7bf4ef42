"""Files that commands are given, opened with the options that commands share."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from .api import Runtime
from .container.layout import Limits
from .errors import InputError, TinySplatError
from .files import read_limited
from .gaussians import Gaussians
from .interchange import load_gaussians
from .reports import Stopwatch

MAX_FILE_BYTES = 1 << 31


def file_limits(args: Namespace) -> Limits:
    """What `--max-pixels` and `--max-memory` allow."""
    default = Limits()
    return Limits(args.max_pixels or default.max_pixels, args.max_memory or default.max_memory_bytes)


def limited_runtime(args: Namespace) -> Runtime:
    """A runtime with the options that commands share."""
    return Runtime(threads=args.threads, limits=file_limits(args))


def decompress_named(runtime: Runtime, data: bytes, args: Namespace, watch: Stopwatch) -> Gaussians:
    """Gaussians of a .tsplat file's bytes; errors name `args.file`."""
    try:
        return runtime.decompress(data, max_bytes=args.max_bytes, watch=watch)
    except TinySplatError as error:
        raise error.within(args.file) from None


def load_any(args: Namespace, watch: Stopwatch) -> Gaussians:
    """The Gaussians of `args.file`, of any format that holds some."""
    if Path(args.file).suffix.lower() == ".tsplat":
        return decompress_named(limited_runtime(args), read_limited(args.file, MAX_FILE_BYTES), args, watch)
    if args.max_bytes is not None:
        raise InputError(f"only .tsplat files can be decoded from a prefix, not {args.file}", where="--max-bytes")
    return load_gaussians(args.file)


def grid_option(values: Sequence[int] | None) -> tuple[int, int, int] | None:
    """`--grid` as a shape."""
    if values is None:
        return None
    if len(values) != 3 or min(values) < 1:
        raise InputError(f"{','.join(map(str, values))}, expected V,H,W of 1 or more", where="--grid")
    return values[0], values[1], values[2]
