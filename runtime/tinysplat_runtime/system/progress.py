"""A progress bar on a terminal, silence elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")


def progress(
    items: Iterable[T], total: int | None, label: str, *, quiet: bool, note: Callable[[], str] = str
) -> Iterator[T]:
    """Yield the items and show how many are done on standard error: tqdm's bar if installed, else a count.

    Args:
        items: what is worked through.
        total: how many there are; None where nobody knows.
        label: what is done.
        quiet: whether to show nothing.
        note: says how things stand, behind the bar.
    """
    if quiet or not sys.stderr.isatty():
        yield from items
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
