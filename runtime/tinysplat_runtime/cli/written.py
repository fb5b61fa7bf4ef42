"""What `decode` and `convert` write: a request of `recipe.export`, carried out by the options of a command line."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ..container.layout import SUFFIX
from ..gaussian.gaussians import Gaussians
from ..recipe.export import exported, write
from ..recipe.request import ExportRequest
from ..system.progress import wipe
from ..system.stopwatch import Stopwatch
from ..system.voice import Voice
from .files import Reading, named, write_file
from .outputs import is_standard


@dataclass(frozen=True)
class Writing:
    """How Gaussians go out.

    Attributes:
        request: which of them, and in what format.
        reading: the options that commands share.
        source: the .tsplat file whose quality a .tsplat file is written with; None for the default profile's.
        output: where to.
        voice: who says what was written.
    """

    request: ExportRequest
    reading: Reading
    source: str | None
    output: str
    voice: Voice

    def write(self, parts: Sequence[tuple[str, Gaussians]], watch: Stopwatch) -> Gaussians:
        """Write a file, or to standard output; what went out. What the format cannot keep goes to standard error."""
        request, runtime, output = self.request, self.reading.runtime(), self.output

        with _file_of(output) as path, named(request.options()):
            gaussians = exported(parts, path, request, runtime, self.voice)
            self.voice.say("step", "writing")
            with watch.stage("write"):
                losses = write(path, gaussians, request, runtime, self.source)
            wipe()
            for loss in losses:
                print(f"{path}: {loss}", file=sys.stderr)
        self.voice.done(f"{gaussians.count} Gaussians of SH degree {gaussians.degree}", output)
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
