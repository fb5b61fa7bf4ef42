"""Files that commands are given, opened with the options that commands share."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..container.layout import MAGIC, MAX_FILE_BYTES, SUFFIX
from ..container.limits import Limits
from ..errors import InputError, within
from ..system import kinds
from ..system.files import read_limited, write_atomically
from ..system.jsonfields import JsonObject
from ..system.options import Options, flag, option
from ..system.progress import wipe
from ..system.stopwatch import Stopwatch
from ..system.told import Told
from .outputs import STANDARD, is_standard

if TYPE_CHECKING:  # of what a file holds, `info` says without them
    from ..api import Runtime
    from ..gaussian.gaussians import Gaussians


@dataclass(frozen=True, kw_only=True)
class Threads(Options, group="running"):
    """How many work."""

    threads: int | None = option(kinds.count, metavar="N", help="default: all cores; changes no result")


@dataclass(frozen=True, kw_only=True)
class Running(Threads, group="running"):
    """What runs graphs."""

    provider: str | None = option(
        kinds.text, metavar="NAME[:K=V,…]", help="of onnxruntime (`tinysplat doctor` lists them)"
    )

    @property
    def limits(self) -> Limits | None:
        """What a file may ask for; None for the usual."""
        return None

    def runtime(self, told: Told) -> Runtime:
        """A runtime with these options."""
        from ..api import Runtime
        from ..graphs.providers import providers_of

        return Runtime(threads=self.threads, providers=providers_of(self.provider), limits=self.limits, told=told)


@dataclass(frozen=True, kw_only=True)
class Limited(Options, group="reading"):
    """What a file may ask for."""

    max_pixels: int | None = option(kinds.count, metavar="N", help="refuse files of more Gaussians (67 M)")
    max_memory: int | None = option(kinds.byte_count, metavar="SIZE", help="refuse files that take more (8GiB)")


@dataclass(frozen=True, kw_only=True)
class Reading(Running, Limited, group="reading"):
    """How files are read."""

    max_bytes: int | None = option(kinds.count, metavar="N", help="decode the first N bytes (`info` lists some)")
    partial: bool = flag(help="decode what is intact and name what is lost")
    model: str | None = option(kinds.text, metavar="NAME|FILE.onnx", help="the network of a file of photos")

    @property
    def is_in_part(self) -> bool:
        """Whether the file may end before its metadata says that it does."""
        return self.max_bytes is not None or self.partial

    @property
    def limits(self) -> Limits:
        """What a file may ask for."""
        usual = Limits()
        return Limits(self.max_pixels or usual.max_pixels, self.max_memory or usual.max_memory_bytes)

    def decompress(
        self, file: str, data: bytes, runtime: Runtime, watch: Stopwatch, views: Sequence[int] | None = None
    ) -> Gaussians:
        """Gaussians of a .tsplat file's bytes, of all views or some; errors name the file, and so does the line that
        says what is lost.
        """
        lost: list[str] | None = [] if self.partial else None
        with within(file):
            gaussians = runtime.decompress(
                data, max_bytes=self.max_bytes, views=views, lost=lost, model=self.model, watch=watch
            )
        if lost:
            wipe()
            print(f"{file}: lost {len(lost)} of its planes: {', '.join(lost)}", file=sys.stderr)
        return gaussians

    def load(
        self,
        file: str,
        runtime: Runtime,
        watch: Stopwatch,
        *,
        views: Sequence[int] | None = None,
        grid: tuple[int, int, int] | None = None,
    ) -> Gaussians:
        """The Gaussians of a file of any format that holds some.

        Args:
            file: its name; `-` is standard input.
            views: those of these alone; None for all.
            grid: (V, H, W) that a list is the pixels of; None for a list, or what the file says.
        """
        data = sys.stdin.buffer.read(MAX_FILE_BYTES) if file == STANDARD else None
        if Path(file).suffix.lower() == SUFFIX or (data is not None and data.startswith(MAGIC)):
            data = read_limited(file, MAX_FILE_BYTES) if data is None else data
            return self.decompress(file, data, runtime, watch, views)
        if self.is_in_part:
            word = "--partial" if self.max_bytes is None else "--max-bytes"
            raise InputError(f"only .tsplat files can be decoded in part, not {file}", where=word)
        from ..gaussian.editing import select_views

        loaded = _other_format(file, data, grid)
        with within(file):
            return loaded if views is None else select_views(loaded, views)


def _other_format(file: str, data: bytes | None, grid: tuple[int, int, int] | None) -> Gaussians:
    """The Gaussians of a file that is no .tsplat one, or of its bytes from standard input."""
    from ..formats.table import load_gaussians  # every format there is, which a .tsplat file is none of

    if data is None:
        return load_gaussians(file, grid)
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"standard input{_suffix_of(data)}"
        copy.write_bytes(data)
        return load_gaussians(copy, grid)


def _suffix_of(data: bytes) -> str:
    """The ending that a file of these bytes would have."""
    from ..formats.table import ending_of

    ending = ending_of(data)
    if ending is None:
        accepted = ".tsplat, .npz, .safetensors, .ply, .spz or .glb"
        raise InputError(f"starts with {data[:4].hex(' ') or 'nothing'}, expected {accepted}", where="standard input")
    return ending


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


def write_json(path: str, value: JsonObject) -> None:
    """Write a report, whole or not at all."""
    write_atomically(path, (json.dumps(value, indent=2) + "\n").encode())
