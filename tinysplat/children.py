"""Worker processes that end with the process that started them, however that ends.

A pool's worker waits on a queue whose writing end its siblings hold open as well: when the parent is killed, it would
wait for ever. Unix and Windows alike.
"""

from __future__ import annotations

import multiprocessing
import os
import threading


def end_with_parent() -> None:
    """Call in a worker: from now on it ends at once when its parent does. Files are never torn by it."""
    threading.Thread(target=_watch, daemon=True).start()


def _watch() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
