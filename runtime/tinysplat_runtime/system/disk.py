"""Arrays of captures on disk, of which memory holds what is being worked on.

What is known of a capture grows with its photos, and is gone through view by view. Such arrays lie in files without
names, mapped into memory, and are used like any others: who makes one says so, and nobody else has to know. Memory
gets as much of them as is touched; while that is more than `HELD_BYTES`, a thread lets go of all of it, again and
again, and what is touched next comes back from the system's cache of files, which takes no memory that others need.
"""

from __future__ import annotations

import ctypes
import math
import mmap
import os
import sys
import tempfile
import threading
import weakref
from functools import lru_cache
from io import FileIO
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike, NDArray

TOGETHER = 6
"""Arrays of up to so many views are worked on as a whole, and stay in memory."""

LEAST_BYTES = 1 << 22
"""Smaller arrays stay there too."""

HELD_BYTES = 150_000_000
"""Memory that these arrays hold, and for a moment more: what is worked on together, unless it is large."""

LASTING = Path("/var/tmp")
"""Where Linux has large files that nobody keeps: often `/tmp` is memory itself."""

MOUNTS, MEMORY = Path("/proc/self/mountinfo"), Path("/proc/self/statm")

WATCHER = "arrays on disk"
"""Name of the thread."""

_EVERY_S = 0.02
"""Between two looks at what is held: in so long a few cores touch some ten megabytes."""


def zeros(shape: tuple[int, ...], dtype: DTypeLike = np.float32, views: int | None = None) -> NDArray:
    """Zeros: of many views, which the first axis counts where nobody says how many, on disk where there is room, else
    in memory.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if (shape[0] if views is None else views) <= TOGETHER or size < LEAST_BYTES or not _is_possible():
        return np.zeros(shape, dtype)
    try:
        with tempfile.TemporaryFile(dir=_folder()) as file:
            os.posix_fallocate(file.fileno(), 0, size)  # a full disk shows here, and not where numbers are written
            mapped = mmap.mmap(file.fileno(), size)
    except OSError:
        return np.zeros(shape, dtype)
    _HELD.watch(mapped)
    return np.frombuffer(mapped, dtype).reshape(shape)


class _Held:
    """Mappings, and the thread that lets go of them; it lives as long as there are some."""

    def __init__(self) -> None:
        self._mappings = weakref.WeakSet[mmap.mmap]()
        self._lock = threading.Lock()
        self._watcher: threading.Thread | None = None

    def let_go(self) -> None:
        """Of all that memory holds of them; what is touched next comes back."""
        with self._lock:
            live = list(self._mappings)
        for mapping in live:
            mapping.madvise(mmap.MADV_DONTNEED)  # they keep what they hold: the files are shared

    def watch(self, mapping: mmap.mmap) -> None:
        with self._lock:
            self._mappings.add(mapping)
            if self._watcher is None:
                self._watcher = threading.Thread(target=self._run, name=WATCHER, daemon=True)
                self._watcher.start()

    def _run(self) -> None:
        never = threading.Event()
        with MEMORY.open("rb", buffering=0) as status:
            others = _mapped_bytes(status)  # that hold other files, such as libraries
            while not never.wait(_EVERY_S):
                with self._lock:
                    if not self._mappings:
                        self._watcher = None
                        return
                if _mapped_bytes(status) - others > HELD_BYTES:
                    self.let_go()


_HELD = _Held()


def let_go() -> None:
    """Give memory back after a part of the work: what holds such arrays, until they are touched again, and what others
    left behind, of which the C library keeps pieces.
    """
    _HELD.let_go()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None  # glibc's alone
    if trim is not None:
        trim(0)


def _mapped_bytes(status: FileIO) -> int:
    """Memory of this process that holds files."""
    return int(os.pread(status.fileno(), 100, 0).split()[2]) * mmap.PAGESIZE


def room() -> int:
    """Bytes that there are for such arrays."""
    if not _is_possible():
        return 0
    try:
        disk = os.statvfs(_folder())
    except OSError:
        return 0
    return disk.f_bavail * disk.f_frsize


def _is_possible() -> bool:
    """Elsewhere nothing reserves a file's bytes, and a full disk would end the process; nor do files in memory help."""
    is_linux = hasattr(os, "posix_fallocate") and hasattr(mmap, "MADV_DONTNEED") and MEMORY.exists()
    return is_linux and not _is_memory(_folder())


@lru_cache
def _is_memory(folder: str) -> bool:
    """Whether a folder's files lie in memory, as far as Linux tells."""
    try:
        mounts = [line.split() for line in MOUNTS.read_text("utf-8", "replace").splitlines()]
    except OSError:
        return False
    above = [os.path.realpath(folder), *map(str, Path(os.path.realpath(folder)).parents)]
    kinds = {fields[4]: fields[fields.index("-") + 1] for fields in mounts}  # of mounts at one place, the last is seen
    return next((kinds[place] in ("tmpfs", "ramfs") for place in above if place in kinds), False)


def _folder() -> str:
    chosen = os.environ.get("TMPDIR")
    return chosen or (str(LASTING) if os.access(LASTING, os.W_OK) else tempfile.gettempdir())
