"""How long a run still takes, by what its stages took so far: no number here is of any one machine.

A run that knows its stages says so with shares, what each is likely to take against the others. Seconds of a share are
those of the stages so far; those of a stage with items are told by these as soon as one is done.
"""

import time
from collections.abc import Callable, Iterable, Sequence

LATEST = 5
"""Items at least that tell what the next will take, where there are so many."""

LEAST_TOLD = 0.02
"""Share of a run that stages have to be which tell what all the others take: one that is less may take many times its
share, as reading large photos does."""


class Stage:
    """Items of one kind, one after another, or a step without any.

    Attributes:
        label: what is done.
        share: of the run's seconds, against other stages; 0 where nobody knows.
        total: how many items there are; None where nobody knows.
        done: how many of them are.
        is_over: whether all items are through, or there are none.
    """

    def __init__(
        self, label: str, share: float, total: int | None, costs: Sequence[float] | None, clock: Callable[[], float]
    ) -> None:
        """Begin; `costs` are of each item against the others, all alike without them. `clock` gives seconds."""
        self.label, self.share, self.total, self.done, self.is_over = label, share, total, 0, False
        self._costs, self._clock = costs, clock
        self._ends, self._together = [clock()], 1

    def next(self, count: int = 1) -> None:
        """So many more items are done."""
        self.done, self._together = self.done + count, count
        since, last = self._clock() - self._ends[-1], self._ends[-1]
        self._ends += [last + since * (number + 1) / count for number in range(count)]

    @property
    def seconds(self) -> float:
        """Since it began."""
        return self._clock() - self._ends[0]

    @property
    def left(self) -> float | None:
        """Seconds, by the latest items, without the first where there are others: it often loads something. None where
        no item tells.
        """
        if not self.done or self.total is None:
            return None
        if self.is_over or self.done >= self.total:
            return 0.0
        first = max(self.done - max(LATEST, self.done // 2), min(self.done - 1, 1))
        work = self._cost(first, self.done)
        if not work:
            return None
        rate = (self._ends[-1] - self._ends[first]) / work
        since = self._clock() - self._ends[-1]
        then = self.done + self._together
        now, later = self._cost(self.done, then), self._cost(then, self.total)
        return max(rate * now - since, 0.0) + rate * later

    @property
    def worked(self) -> float:
        """Its share, as far as its items are done."""
        whole = self._cost(0, self.total or 0)
        return self.share * self._cost(0, self.done) / whole if whole else self.share

    def _cost(self, start: int, end: int) -> float:
        """Of items together, of which there are no more than `total`."""
        end = end if self.total is None else min(end, self.total)
        return sum(self._costs[start:end]) if self._costs is not None else float(max(end - start, 0))


class Course:
    """A run's stages: those that are known ahead, and others that come up.

    Attributes:
        now: the stage at hand; None before the first.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """`clock` gives seconds."""
        self._clock = clock
        self._past: list[tuple[float, float]] = []  # what stages worked of their shares, and their seconds
        self.now: Stage | None = None
        self._ahead: list[tuple[str, float]] = []
        self._begun = clock()

    @property
    def way(self) -> float | None:
        """Share of the way that is done; None where nothing tells yet."""
        left = self.left
        if left is None or self.now is None:
            return None
        taken = self._clock() - self._begun if self.now.share else self.now.seconds
        return taken / max(taken + left, 1e-9)

    def plan(self, stages: Iterable[tuple[str, float]]) -> None:
        """What comes after the stage at hand: labels and shares above 0, in order."""
        self._ahead = list(stages)

    def begin(self, label: str, total: int | None = None, costs: Sequence[float] | None = None) -> Stage:
        """Go on to a stage, which lasts until the next one begins.

        Those planned before it are left out. One of the same label as before takes its place. One that is not planned
        has its own pace alone; one that begins within another's items is no stage of the run.

        Args:
            label: what is done, as planned.
            total: how many items there are; None where nobody knows.
            costs: of each item against the others, where they are not alike.
        """
        if self.now is not None and not self.now.is_over:
            return Stage(label, 0.0, total, costs, self._clock)
        labels, share = [name for name, _ in self._ahead], 0.0
        if label in labels:
            place = labels.index(label)
            share = self._ahead[place][1]
            del self._ahead[: place + 1]
        elif self.now is not None and label == self.now.label:
            share = self.now.share
        if self.now is not None and self.now.worked and label != self.now.label:
            self._past.append((self.now.worked, self.now.seconds))
        self.now = Stage(label, share, total, costs, self._clock)
        return self.now

    @property
    def left(self) -> float | None:
        """Seconds of all that is known to come; None where nothing tells yet."""
        if self.now is None:
            return None
        stage, rest = self.now, self.now.left
        told = self._past
        if stage.share and rest is not None:
            told = [*told, (stage.worked if stage.is_over else stage.share, stage.seconds + rest)]
        ahead, known = sum(share for _, share in self._ahead), sum(share for share, _ in told)
        is_told = known > LEAST_TOLD * (known + ahead)
        each = sum(seconds for _, seconds in told) / known if is_told else None
        if rest is None and stage.share and each is not None:
            rest = max(each * stage.share - stage.seconds, 0.0)
        if rest is None or (ahead and each is None):
            return None
        return rest + ahead * (each or 0.0)
