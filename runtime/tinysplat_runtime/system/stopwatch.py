"""Where time and memory go: seconds by stage, as `--report` has them, and by part within a stage, for who studies it.

Stages are few and always timed. Parts are named where the work is done (`with part("CRC"): …`), cost next to nothing
while nobody looks, and are collected by `watched_parts`; so that a measurement names what it measures, and no function.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from threading import Lock, local

import numpy as np
from numpy.typing import NDArray


@dataclass
class Stopwatch:
    """Wall-clock seconds by stage; stages that run several times add up."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block under `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - start)

    def add(self, name: str, seconds: float) -> None:
        """Add seconds that were measured elsewhere."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds


class Parts:
    """Seconds of parts by name, each less those of parts within it, and tallies by name.

    With several threads, seconds are those of all of them together.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.tallies: dict[str, int] = {}
        self._lock, self._local = Lock(), local()

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Time the block under `name`."""
        within = self._local.__dict__.setdefault("within", [0.0])
        within.append(0.0)
        start = time.perf_counter()
        try:
            yield
        finally:
            spent = time.perf_counter() - start
            own = spent - within.pop()
            within[-1] += spent
            with self._lock:
                self.seconds[name] = self.seconds.get(name, 0.0) + own

    def tally(self, name: str, count: int) -> None:
        """Add to a tally."""
        with self._lock:
            self.tallies[name] = self.tallies.get(name, 0) + count


_watched: Parts | None = None
_UNWATCHED = nullcontext()


@contextmanager
def watched_parts() -> Iterator[Parts]:
    """While open, parts of this process's work are timed; one at a time."""
    global _watched
    before, _watched = _watched, Parts()
    try:
        yield _watched
    finally:
        _watched = before


def part(name: str) -> AbstractContextManager[None]:
    """A block of work that has a name; timed within `watched_parts`."""
    return _UNWATCHED if _watched is None else _watched.part(name)


def tally_nonzero(name: str, values: NDArray) -> None:
    """Within `watched_parts`, add how many of the values (any shape and dtype) are not 0 to a tally."""
    if _watched is not None:
        _watched.tally(name, int(np.count_nonzero(values)))


def peak_rss_bytes() -> int:
    """Largest resident memory of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
