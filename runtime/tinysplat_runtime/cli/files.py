"""Files that commands are given, opened with the options that commands share."""

from __future__ import annotations

import contextlib
import json
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..container.layout import MAGIC, MAX_FILE_BYTES, SUFFIX
from ..container.limits import Limits
from ..errors import InputError, within
from ..system.files import read_limited, write_atomically
from ..system.progress import wipe
from ..system.stopwatch import Stopwatch
from ..system.told import NOBODY, Told
from .outputs import STANDARD, is_standard

if TYPE_CHECKING:  # of what a file holds, `info` says without them
    from ..api import Runtime
    from ..gaussian.gaussians import Gaussians


@dataclass(frozen=True)
class Reading:
    """How files are read, by the options that commands share.

    Attributes:
        threads: None for all cores.
        provider: onnxruntime's, as `--provider` has it.
        limits: what a file may ask for.
        max_bytes: decode from this many first bytes alone; None for all.
        partial: decode what is intact, and say what is lost.
        model: the network for a file of photos; None to find it by its hash.
        views: read these views alone; None for all.
        grid: (V, H, W) that a list is the pixels of; None for a list, or what the file says.
        told: who is told how far that is.
    """

    threads: int | None
    provider: str | None
    limits: Limits
    max_bytes: int | None
    partial: bool
    model: str | None
    views: Sequence[int] | None = None
    grid: tuple[int, int, int] | None = None
    told: Told = NOBODY

    @property
    def is_in_part(self) -> bool:
        """Whether the file may end before its metadata says that it does."""
        return self.max_bytes is not None or self.partial

    def runtime(self) -> Runtime:
        """A runtime with these options."""
        from ..api import Runtime
        from ..graphs.providers import providers_of

        providers = providers_of(self.provider)
        return Runtime(threads=self.threads, providers=providers, limits=self.limits, told=self.told)

    def decompress(self, file: str, data: bytes, watch: Stopwatch) -> Gaussians:
        """Gaussians of a .tsplat file's bytes; errors name the file, and so does the line that says what is lost."""
        lost: list[str] | None = [] if self.partial else None
        with within(file):
            gaussians = self.runtime().decompress(
                data, max_bytes=self.max_bytes, views=self.views, lost=lost, model=self.model, watch=watch
            )
        if lost:
            wipe()
            print(f"{file}: lost {len(lost)} of its planes: {', '.join(lost)}", file=sys.stderr)
        return gaussians

    def load(self, file: str, watch: Stopwatch) -> Gaussians:
        """The Gaussians of a file of any format that holds some; `-` is standard input."""
        data = sys.stdin.buffer.read(MAX_FILE_BYTES) if file == STANDARD else None
        if Path(file).suffix.lower() == SUFFIX or (data is not None and data.startswith(MAGIC)):
            return self.decompress(file, read_limited(file, MAX_FILE_BYTES) if data is None else data, watch)
        for option, value in (("--max-bytes", self.max_bytes), ("--partial", self.partial or None)):
            if value is not None:
                raise InputError(f"only .tsplat files can be decoded in part, not {file}", where=option)
        from ..gaussian.editing import select_views

        loaded = _other_format(file, data, self.grid)
        with within(file):
            return loaded if self.views is None else select_views(loaded, self.views)


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


def write_json(path: str, value: dict[str, Any]) -> None:
    """Write a report, whole or not at all."""
    write_atomically(path, (json.dumps(value, indent=2) + "\n").encode())


@contextlib.contextmanager
def named(options: Iterable[str]) -> Iterator[None]:
    """Fields of a request as the options that they came from."""
    try:
        yield
    except InputError as error:
        outer, _, name = (error.where or "").rpartition(": ")
        if name in options:
            message = re.sub(r"^(given with(?:out)?) (\w+)", lambda one: f"{one[1]} {_option(one[2])}", error.message)
            option = _option(name)
            raise InputError(message, where=f"{outer}: {option}" if outer else option) from None
        raise


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
