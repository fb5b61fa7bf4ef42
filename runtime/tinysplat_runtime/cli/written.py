"""What `decode` and `convert` write: a request of `recipe.export`, carried out by the options of a command line."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ..container.layout import SUFFIX
from ..gaussian.gaussians import Gaussians
from ..recipe.export import ExportListener, exported, write
from ..recipe.request import ExportRequest
from ..system.progress import progress
from ..system.stopwatch import Stopwatch
from .files import Reading, Voice, named, write_file
from .outputs import is_standard


@dataclass(frozen=True)
class Writing:
    """How Gaussians go out.

    Attributes:
        request: which of them, and in what format.
        reading: the options that commands share.
        source: the .tsplat file whose quality a .tsplat file is written with; None for the default profile's.
        say: who says what was written, and where to.
    """

    request: ExportRequest
    reading: Reading
    source: str | None
    say: Voice

    def write(self, parts: Sequence[tuple[str, Gaussians]], watch: Stopwatch) -> Gaussians:
        """Write a file, or to standard output; what went out. What the format cannot keep goes to standard error."""
        request, runtime, quiet = self.request, self.reading.runtime(), self.say.quiet

        def fusing(steps: Iterable[int], note: Callable[[], str]) -> Iterator[int]:
            return progress(steps, None, "fuse", quiet=quiet, note=note)

        def notice(text: str) -> None:
            if not quiet:
                print(text, file=sys.stderr)

        with _file_of(self.say.output) as path, named(request.options()):
            gaussians = exported(parts, path, request, runtime, ExportListener(notice, self.say, fusing))
            with watch.stage("write"):
                losses = write(path, gaussians, request, runtime, self.source)
            for loss in losses:
                print(f"{path}: {loss}", file=sys.stderr)
        self.say(f"{self.say.output}: {gaussians.count} Gaussians of SH degree {gaussians.degree}")
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
