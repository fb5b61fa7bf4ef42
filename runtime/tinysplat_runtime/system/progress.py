"""What long work says while it runs: on a terminal a line that changes each second, in a log a line now and then.

Blocks of work lie within each other. A command is the outermost, which speaks only where none within it does, so that
it is never silent for long (`still_there`).
"""

import contextlib
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from .course import Course, Stage
from .printable import printable

T = TypeVar("T")

LOG_EVERY_S = 50.0
"""Seconds between lines where standard error is no terminal."""

TERMINAL_EVERY_S = 1.0

LEAST_LEFT_S = 2.0
"""Seconds left that are worth saying."""

BAR = 20
"""Characters of a terminal's bar."""


class _Compiling:
    """How long kernels compiled so far.

    Attributes:
        is_kept: whether they do so once for all runs.
    """

    def __init__(self) -> None:
        self.is_kept = True
        self._taken, self._since, self._depth = 0.0, 0.0, 0

    def begin(self) -> None:
        """A kernel compiles, maybe on behalf of another one."""
        if not self._depth:
            self._since = time.monotonic()
        self._depth += 1

    def end(self) -> None:
        """It is compiled."""
        self._depth -= 1
        if not self._depth:
            self._taken += time.monotonic() - self._since

    @property
    def seconds(self) -> float:
        """In all."""
        return self._taken + (time.monotonic() - self._since if self._depth else 0.0)

    @property
    def text(self) -> str:
        """For people, while it goes on."""
        often = "once" if self.is_kept else "in every run, as no folder can be written to (NUMBA_CACHE_DIR names one)"
        return f"compiling {often}: {self.seconds:.0f} s" if self._depth else ""


compiling = _Compiling()


def running() -> float:
    """Seconds of a clock that stands still while kernels compile: what they take says nothing about what is left."""
    return time.monotonic() - compiling.seconds


class _Speaker:
    """The process's one, as it has one standard error."""

    def __init__(self) -> None:
        self._texts: list[Callable[[], str]] = []
        self._ended = threading.Event()
        self._lock, self._has_line = threading.Lock(), False

    @contextlib.contextmanager
    def saying(self, text: Callable[[], str]) -> Iterator[None]:
        """Say `text` now and then from another thread, and after it what blocks within this one have to say."""
        self._texts.append(text)
        if len(self._texts) == 1:
            self._ended = threading.Event()
            threading.Thread(target=self._run, args=(self._ended,), daemon=True).start()
        try:
            yield
        finally:
            self._texts.remove(text)
            if not self._texts:
                self._ended.set()
            self.wipe()

    def wipe(self) -> None:
        """Take away the line that stands on a terminal: something else is to be printed."""
        with self._lock:
            if self._has_line:
                print("\r\033[K", end="", file=sys.stderr, flush=True)
            self._has_line = False

    def _run(self, ended: threading.Event) -> None:
        terminal = sys.stderr.isatty()
        while not ended.wait(TERMINAL_EVERY_S if terminal else LOG_EVERY_S):
            with self._lock:
                if ended.is_set() or not (texts := self._texts[1:] or self._texts[:1]):
                    continue
                said = printable("; ".join(text() for text in texts))
                self._has_line = terminal
                line = f"\r{said[: shutil.get_terminal_size().columns - 1]}\033[K\r" if terminal else f"{said}\n"
                print(line, end="", file=sys.stderr, flush=True)


_speaker = _Speaker()
wipe = _speaker.wipe

_step: list[Callable[[], str]] = [str]
"""What the outermost block says."""


def progress(
    items: Iterable[T], stage: Stage, course: Course, note: Callable[[], str], size_of: Callable[[T], int] | None
) -> Iterator[T]:
    """Yield the items and show how many are done on standard error.

    Args:
        items: what is worked through.
        stage: begun with them.
        course: of the whole run, whose seconds left are said.
        note: says how things stand.
        size_of: how many an item counts for; None for one.
    """

    def text() -> str:
        of = "" if stage.total is None else f" of {stage.total:,}"
        whole = _left(course) if stage is course.now else ""
        return _joined(f"{stage.label}: {stage.done:,}{of}", whole, note())

    _step[0] = text  # until the next one begins
    try:
        with _speaker.saying(text):
            for item in items:
                yield item
                stage.next(size_of(item) if size_of else 1)
    finally:
        stage.is_over = True


@contextlib.contextmanager
def working(label: str, *, quiet: bool, note: Callable[[], str] = str) -> Iterator[None]:
    """Say on standard error that work goes on, for how long, and what `note` says."""
    if quiet:
        yield
        return
    since = time.monotonic()
    with _speaker.saying(lambda: _joined(f"{label}: {time.monotonic() - since:.0f} s", note(), compiling.text)):
        yield


@contextlib.contextmanager
def still_there(label: str, *, quiet: bool) -> Iterator[None]:
    """Say that a command runs, and which step of it, where nothing within it speaks."""
    step(label)
    if quiet:
        yield
        return
    with _speaker.saying(lambda: _step[0]()):
        yield


def step(label: str, course: Course | None = None) -> None:
    """From now on this is what a command does, on the way of `course`."""
    since, run = time.monotonic(), course or Course()
    _step[0] = lambda: _joined(f"{label}: {time.monotonic() - since:.0f} s", _left(run))


def _left(course: Course) -> str:
    """For people, such as `about 40 s left`, on a terminal after a bar; empty where nobody knows. How long what
    compiles will still take nobody does.
    """
    left, way = course.left, course.way
    if left is None or way is None or left < LEAST_LEFT_S:
        return compiling.text
    said = f"about {left:.0f} s left" if left < 100 else f"about {left / 60:.0f} min left"
    said = f"{compiling.text}, then {said}" if compiling.text else said
    return f"[{'#' * round(BAR * way):.<{BAR}}] {said}" if sys.stderr.isatty() else said


def _joined(*parts: str) -> str:
    return ", ".join(part for part in parts if part)
