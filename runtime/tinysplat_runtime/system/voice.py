"""What a run has to say, said to people: how far it is, what was found, and what was done."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from dataclasses import dataclass, field
from os import PathLike

from .course import Course
from .printable import printable
from .progress import progress, running, step, wipe
from .told import Kind, T, Told


@dataclass(frozen=True)
class Voice(Told):
    """Says on standard error at which step a run is, about how many seconds are left of all of it, what was found or
    chosen unasked, and what is likely wrong.

    Attributes:
        quiet: say nothing.
        shows_results: what was done goes to standard output.
        course: the run's.
    """

    quiet: bool = False
    shows_results: bool = False
    course: Course = field(default_factory=lambda: Course(running), repr=False, compare=False)

    @property
    def listens(self) -> bool:  # type: ignore[override]
        """Unless `quiet`."""
        return not self.quiet

    def say(self, kind: Kind, text: str, where: str | PathLike[str] = "") -> None:
        """Say a line."""
        if self.quiet:
            return
        if kind == "step":
            self.course.begin(text).is_over = True
            step(text, self.course)
            return
        wipe()
        place = f"{os.fspath(where)}: " if where else ""
        doubt = "warning: " if kind == "doubt" else ""
        stream = sys.stdout if kind == "done" and self.shows_results else sys.stderr
        print(printable(f"{place}{doubt}{text}"), file=stream)

    def done(self, text: str, where: str | PathLike[str] = "") -> None:
        """Say what was done."""
        self.say("done", text, where)

    def plan(self, stages: Iterable[tuple[str, float]]) -> None:
        """From here on seconds left are those of all of this."""
        self.course.plan(stages)

    def progress(
        self,
        label: str,
        items: Iterable[T],
        note: Callable[[], str] = str,
        total: int | None = None,
        costs: Sequence[float] | None = None,
        size_of: Callable[[T], int] | None = None,
    ) -> Iterator[T]:
        """Say how far a step is."""
        if self.quiet:
            yield from items
            return
        if total is None and isinstance(items, Sized):
            total = len(items)
        yield from progress(items, self.course.begin(label, total, costs), self.course, note, size_of)
