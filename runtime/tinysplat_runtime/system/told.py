"""Who is told what long work does: what it found, what it doubts, how far it is.

Steps say it to a `Told`, and each door has its own: a command prints, Python warns, a batch keeps a record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from threading import Lock
from typing import Any, Literal, TypeVar

from ..errors import SceneWarning, warn

T = TypeVar("T")

Kind = Literal["step", "notice", "doubt", "done"]
"""What now begins, what was found or chosen unasked, what is likely wrong with what was given, and what was done."""


class Told:
    """Nobody; who listens overrides `say`, `plan` and `progress`.

    Attributes:
        listens: whether doubts are worth looking for.
    """

    listens = False

    def say(self, kind: Kind, text: str, where: str | PathLike[str] = "") -> None:
        """A line about `where`, a scene or a file."""

    def plan(self, stages: Iterable[tuple[str, float]]) -> None:
        """What is going to be done from here on: labels of steps, in order, and what each is likely to take against the
        others, so that seconds left can be told of all of them together.
        """

    def progress(
        self,
        label: str,
        items: Iterable[T],
        note: Callable[[], str] = str,
        total: int | None = None,
        costs: Sequence[float] | None = None,
        size_of: Callable[[T], int] | None = None,
    ) -> Iterator[T]:
        """Passes the items of a step on.

        Args:
            label: the step.
            items: what it works through.
            note: says how things stand.
            total: how many there are; None for as many as `items` has, where it knows.
            costs: what each takes against the others, where they are not alike.
            size_of: how many an item counts for, such as the photos of a part of them; None for one.
        """
        return iter(items)

    @contextmanager
    def counting(self, label: str, total: int) -> Iterator[Callable[[], object]]:
        """For a step that is not a loop: what to call, from any thread, whenever another of its items is done."""
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

    def counted(self, label: str, run_jobs: Callable[..., Any]) -> Callable[..., Any]:
        """`run_jobs`, which maps a function over a list on any number of threads, and tells of each item."""

        def run(job: Callable[[Any], Any], items: Iterable[Any]) -> Any:
            every = list(items)
            with self.counting(label, len(every)) as another:

                def one(item: Any) -> Any:
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
