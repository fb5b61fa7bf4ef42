"""What `decode` and `convert` write: a request of `recipe.export`, to a file or to standard output."""

import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..api import Runtime
from ..container.layout import SUFFIX
from ..gaussian.gaussians import Gaussians
from ..recipe.export import exported, write
from ..recipe.request import ExportRequest
from ..system.progress import wipe
from ..system.stopwatch import Stopwatch
from .asks import Written
from .files import write_file
from .options import named
from .outputs import is_standard


def write_gaussians(
    asked: Written,
    parts: Sequence[tuple[str, Gaussians]],
    request: ExportRequest,
    runtime: Runtime,
    watch: Stopwatch,
    *,
    source: str | None,
) -> Gaussians:
    """Write a file, or to standard output; what went out. What the format cannot keep goes to standard error.

    Args:
        asked: where to.
        parts: Gaussians, each with the name of its file for messages.
        request: which of them, and in what format.
        runtime: whose `told` says what goes on.
        watch: gets the seconds of `write`.
        source: the file whose quality a .tsplat file is written with, if it is one; None for the default profile's.
    """
    voice = asked.voice
    if source is not None and not source.lower().endswith(SUFFIX):
        source = None
    with _file_of(asked.output) as path, named(request.options()):
        gaussians = exported(parts, path, request, runtime, voice)
        voice.say("step", "writing")
        with watch.stage("write"):
            losses = write(path, gaussians, request, runtime, source)
        wipe()
        for loss in losses:
            print(f"{path}: {loss}", file=sys.stderr)
    voice.done(f"{gaussians.count} Gaussians of SH degree {gaussians.degree}", asked.output)
    return gaussians


@contextmanager
def _file_of(path: str) -> Iterator[str]:
    """The file to write; for standard output a temporary one, whose bytes then go there. `-` is a .tsplat file."""
    if not is_standard(path):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"standard output{Path('x' + path[1:]).suffix or SUFFIX}"
        yield str(copy)
        write_file(path, copy.read_bytes())
