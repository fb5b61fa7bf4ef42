"""What long work says while it runs: a bar or seconds on a terminal, a line now and then in a log."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")

LOG_EVERY_S = 60.0
"""Seconds between lines where standard error is no terminal."""


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
    if not sys.stderr.isatty():
        yield from _logged(items, total, label, note)
        return
    try:
        from tqdm import tqdm
    except ImportError:
        done, of = 0, "" if total is None else f"/{total}"
        for item in items:
            print(f"\r{label} {done}{of} {note()}", end="", file=sys.stderr, flush=True)
            yield item
            done += 1
        print(f"\r{label} {done}{of} {note()}", file=sys.stderr)
        return
    with tqdm(items, total=total, desc=label, delay=1.0, file=sys.stderr) as bar:
        for item in bar:
            yield item
            bar.set_postfix_str(note(), refresh=False)


def _logged(items: Iterable[T], total: int | None, label: str, note: Callable[[], str]) -> Iterator[T]:
    start = said = time.monotonic()
    of = "" if total is None else f" of {total}"
    for done, item in enumerate(items):
        now = time.monotonic()
        if now - said >= LOG_EVERY_S:
            said = now
            print(f"{label}: {done}{of}, {now - start:.0f} s {note()}".rstrip(), file=sys.stderr, flush=True)
        yield item


@contextlib.contextmanager
def working(label: str, *, quiet: bool) -> Iterator[None]:
    """Say on standard error that work goes on which cannot say how far it is: seconds, each second on a terminal."""
    if quiet:
        yield
        return
    ended, terminal, start = threading.Event(), sys.stderr.isatty(), time.monotonic()

    def speak() -> None:
        while not ended.wait(1.0 if terminal else LOG_EVERY_S):
            seconds = f"{time.monotonic() - start:.0f} s"
            text = f"\r{label} {seconds}" if terminal else f"{label}: {seconds}\n"
            print(text, end="", file=sys.stderr, flush=True)

    speaker = threading.Thread(target=speak, daemon=True)
    speaker.start()
    try:
        yield
    finally:
        ended.set()
        speaker.join()
        if terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
