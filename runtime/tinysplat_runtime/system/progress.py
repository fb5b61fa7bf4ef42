"""What long work says while it runs: a bar or seconds on a terminal, a line now and then in a log.

Blocks of work lie within each other, and the innermost speaks. A command is the outermost, so that none is silent for
long whatever it does (`still_there`).
"""

from __future__ import annotations

import contextlib
import itertools
import statistics
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from .printable import printable

T = TypeVar("T")

LOG_EVERY_S = 50.0
"""Seconds between lines where standard error is no terminal."""

TERMINAL_EVERY_S = 1.0

LATEST, LEAST_LEFT_S = 5, 2.0
"""Items at least that tell what the next will take; and seconds left that are worth saying."""

_speaking: list[object] = []
"""Who may speak, outermost first: the process has one standard error."""

asides: list[str] = []
"""What goes on besides, and why a step takes longer than it will the next time."""

_step = [""]
"""What the outermost says that it does."""


def progress(
    items: Iterable[T], total: int | None, label: str, *, quiet: bool, note: Callable[[], str] = str
) -> Iterator[T]:
    """Yield the items and show how many are done on standard error.

    A terminal gets tqdm's bar if it is installed, else a count; a log a line every LOG_EVERY_S.

    Args:
        items: what is worked through.
        total: how many there are; None where nobody knows.
        label: what is done.
        quiet: whether to show nothing.
        note: says how things stand, behind the bar.
    """
    if quiet:
        yield from items
        return
    bar = _bar(total, label) if sys.stderr.isatty() else None
    if bar is not None:
        with bar, _speaker(bar.refresh):
            for item in items:
                yield item
                bar.update()
                bar.set_postfix_str(printable(note()), refresh=False)
        return
    pace, of = Pace(total), "" if total is None else f"/{total}"
    with working(label, quiet=quiet, note=lambda: f"{pace.done}{of}{pace.text} {note()}"):
        for item in items:
            yield item
            pace.next()


class Pace:
    """How long a step still takes, by what its items took.

    What most of the latest took is what the next will take: the first one of all often loads or compiles something.

    Attributes:
        done: how many items are.
    """

    def __init__(self, total: int | None, clock: Callable[[], float] = time.monotonic) -> None:
        """`total` is how many items there are; None where nobody knows. `clock` gives seconds."""
        self.done, self._total, self._clock = 0, total, clock
        self._ends = [clock()]

    def next(self) -> None:
        """Another item is done."""
        self.done += 1
        self._ends.append(self._clock())

    @property
    def left(self) -> float | None:
        """Seconds; None before the first item is done, and where nobody knows how many there are."""
        if self._total is None or not self.done:
            return None
        latest = -max(LATEST, self.done // 2) - 1
        ends = self._ends[latest:]
        each = statistics.median(end - start for start, end in itertools.pairwise(ends))
        return max(each * (self._total - self.done) - (self._clock() - ends[-1]), 0.0)

    @property
    def text(self) -> str:
        """For people, such as ` about 40 s left`; empty where nobody knows, or it is hardly worth saying."""
        left = self.left
        if left is None or left < LEAST_LEFT_S:
            return ""
        return f" about {left:.0f} s left" if left < 100 else f" about {left / 60:.0f} min left"


@contextlib.contextmanager
def working(label: str, *, quiet: bool, note: Callable[[], str] = str) -> Iterator[None]:
    """Say on standard error that work goes on: seconds, each second on a terminal, and what `note` says."""
    terminal, start = sys.stderr.isatty(), time.monotonic()

    def speak() -> None:
        text = printable(" ".join([f"{time.monotonic() - start:.0f} s", note(), *asides[-1:]]))
        print(f"\r{label} {text}\033[K" if terminal else f"{label}: {text}\n", end="", file=sys.stderr, flush=True)

    if quiet:
        yield
        return
    try:
        with _speaker(speak):
            yield
    finally:
        if terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


@contextlib.contextmanager
def still_there(label: str, *, quiet: bool) -> Iterator[None]:
    """Say that a command runs, where nothing within it speaks, and in a log which step of it.

    On a terminal these are few characters, and the cursor returns before them: whatever is printed next covers them.
    """
    terminal, start = sys.stderr.isatty(), time.monotonic()

    def speak() -> None:
        seconds = " ".join([f"{time.monotonic() - start:.0f} s", *asides[-1:]])
        print(f"\r{seconds}\r" if terminal else f"{_step[0]}: {seconds}\n", end="", file=sys.stderr, flush=True)

    step(label)
    if quiet:
        yield
        return
    with _speaker(speak):
        yield


def step(label: str) -> None:
    """From now on this is what a command does."""
    _step[0] = label


@contextlib.contextmanager
def _speaker(speak: Callable[[], object]) -> Iterator[None]:
    """Call `speak` now and then from another thread, while no block within this one has a speaker of its own."""
    ended, every = threading.Event(), TERMINAL_EVERY_S if sys.stderr.isatty() else LOG_EVERY_S

    def run() -> None:
        while not ended.wait(every):
            if _speaking[-1:] == [ended]:
                speak()

    thread = threading.Thread(target=run, daemon=True)
    _speaking.append(ended)
    thread.start()
    try:
        yield
    finally:
        _speaking.remove(ended)
        ended.set()
        thread.join()


def _bar(total: int | None, label: str) -> Any:
    """tqdm's, or None where that is not installed."""
    try:
        from tqdm import tqdm
    except ImportError:
        return None
    return tqdm(total=total, desc=label, delay=1.0, file=sys.stderr)
