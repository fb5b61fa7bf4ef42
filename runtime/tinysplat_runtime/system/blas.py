"""One BLAS thread for small matrices, where the library lets itself be told.

numpy's wheels carry OpenBLAS, which runs even a 75 × 75 eigen-decomposition on all cores: its last bits then depend on
their number, and a busy core makes it wait for a time slice, 10 to 50 ms where the work is 0.4. Other builds of numpy
are left as they are.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import numpy as np

_lock = threading.Lock()


@lru_cache(maxsize=1)
def _thread_count() -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """OpenBLAS's getter and setter of its number of threads, if it is the one in numpy's wheel."""
    for path in sorted((Path(np.__file__).parents[1] / "numpy.libs").glob("*openblas*")):
        library = ctypes.CDLL(str(path))
        for name in ("scipy_openblas_{}_num_threads64_", "openblas_{}_num_threads64_"):
            if hasattr(library, name.format("set")):
                return getattr(library, name.format("get")), getattr(library, name.format("set"))
    return None


@contextmanager
def single_thread() -> Iterator[None]:
    """Run the block's linear algebra on one thread."""
    functions = _thread_count()
    if functions is None:
        yield
        return
    get, put = functions
    with _lock:
        before = get()
        put(1)
        try:
            yield
        finally:
            put(before)
