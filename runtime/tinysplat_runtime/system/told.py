"""Who is told what long work does: what it found, what it doubts, how far it is.

Steps say it to a `Told`, and each door has its own: a command prints, Python warns, a batch keeps a record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from os import PathLike
from typing import Literal, TypeVar

T = TypeVar("T")

Kind = Literal["step", "notice", "doubt", "done"]
"""What now begins, what was found or chosen unasked, what is likely wrong with what was given, and what was done."""


class Told:
    """Nobody; who listens overrides all of this.

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
        size_of: Callable[[T], int] = lambda item: 1,
    ) -> Iterator[T]:
        """Passes the items of a step on.

        Args:
            label: the step.
            items: what it works through.
            note: says how things stand.
            total: how many there are; None for as many as `items` has, where it knows.
            costs: what each takes against the others, where they are not alike.
            size_of: how many an item counts for, such as the photos of a part of them.
        """
        return iter(items)


NOBODY = Told()
