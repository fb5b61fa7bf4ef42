"""Worker processes that end when they should: with the process that started them, and at once when interrupted.

A pool's worker waits on a queue whose writing end its siblings hold open as well: when the parent is killed, it would
wait for ever; and an interrupt, which a terminal sends to all, would end it with a traceback. Files are never torn by
either, since they are renamed into place.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def starting_workers() -> Iterator[None]:
    """Processes that the block starts, as a pool does when it is first given work, see no interrupt before they are
    settled; one that comes meanwhile is kept for all. Windows has no such mask: a traceback more there, at worst.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    came: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    # The mask is what workers inherit; a library's thread may still take the signal here, which Python then raises.
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if is_main else None
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if is_main:
            signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def settle_worker() -> None:
    """Call in a worker that was started so, first of all."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
