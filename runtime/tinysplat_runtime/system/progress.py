"""A progress bar on a terminal, silence elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")


def progress(items: Iterable[T], total: int, label: str, *, quiet: bool) -> Iterator[T]:
    """Yield the items and show how many are done on standard error: tqdm's bar if installed, else a count."""
    if quiet or not sys.stderr.isatty():
        yield from items
        return
    try:
        from tqdm import tqdm
    except ImportError:
        for done, item in enumerate(items):
            print(f"\r{label} {done}/{total}", end="", file=sys.stderr, flush=True)
            yield item
        print(f"\r{label} {total}/{total}", file=sys.stderr)
        return
    yield from tqdm(items, total=total, desc=label, delay=1.0, file=sys.stderr)
