"""Messages and progress of long work.

Steps report to a `Told`, of which each caller has its own: a command prints, Python warns, a batch keeps a record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from threading import Lock
from typing import Literal, TypeVar

from ..errors import SceneWarning, warn

T = TypeVar("T")
R = TypeVar("R")

Kind = Literal["step", "notice", "doubt", "done"]
"""What begins, what was found or chosen by default, what is likely wrong with the input, and what was done."""


class Told:
    """Ignores everything; subclasses override `say`, `plan` and `progress`.

    Attributes:
        listens: whether doubts are worth looking for.
    """

    listens = False

    def say(self, kind: Kind, text: str, where: str | PathLike[str] = "") -> None:
        """A line about `where`, a scene or a file."""

    def plan(self, stages: Iterable[tuple[str, float]]) -> None:
        """The steps from here on, as (label, usual share of the time), from which the seconds left are estimated."""

    def progress(
        self,
        label: str,
        items: Iterable[T],
        note: Callable[[], str] = str,
        total: int | None = None,
        costs: Sequence[float] | None = None,
        size_of: Callable[[T], int] | None = None,
    ) -> Iterator[T]:
        """Yield the items of a step, reporting each.

        Args:
            label: name of the step.
            items: what it works through.
            note: returns a note on the current state.
            total: number of items; None for the length of `items`, if it has one.
            costs: relative cost of each item, if they differ.
            size_of: how many an item counts for, such as the photos in a group; None for one.
        """
        return iter(items)

    @contextmanager
    def counting(self, label: str, total: int) -> Iterator[Callable[[], object]]:
        """For a step that is not a loop: a function to call, from any thread, each time an item is done."""
        counted, lock = iter(self.progress(label, range(total))), Lock()
        next(counted, None)  # the first begins

        def another() -> None:
            with lock:
                next(counted, None)

        try:
            yield another
        finally:
            for _ in counted:  # what was left out, or failed
                pass

    def counted(self, label: str, run_jobs: Callable[..., R]) -> Callable[..., R]:
        """`run_jobs`, which maps a function over a list on any number of threads, made to report each item."""

        def run(job: Callable[[T], object], items: Iterable[T]) -> R:
            every = list(items)
            with self.counting(label, len(every)) as another:

                def one(item: T) -> object:
                    found = job(item)
                    another()
                    return found

                return run_jobs(one, every)

        return run


NOBODY = Told()


class Warned(Told):
    """Doubts become warnings."""

    listens = True

    def say(self, kind: Kind, text: str, where: str | PathLike[str] = "") -> None:
        if kind == "doubt":
            warn(f"{where}: {text}", SceneWarning)
