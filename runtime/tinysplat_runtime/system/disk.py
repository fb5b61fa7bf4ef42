"""Arrays of captures on disk; memory holds only the parts in use.

The arrays of a capture grow with its photos, and are processed view by view. They are unnamed files mapped into memory,
and code uses them like any other array. Only pages that are touched take memory. When these exceed `HELD_BYTES`, a
thread releases all of them; what is touched next comes back from the system's file cache, which yields its memory
whenever others need it.
"""

import ctypes
import math
import mmap
import os
import sys
import tempfile
import threading
import weakref
from collections.abc import Callable
from functools import lru_cache
from io import FileIO
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike, NDArray

TOGETHER = 6
"""Arrays of this many views or fewer stay in memory."""

LEAST_BYTES = 1 << 22
"""Smaller arrays stay in memory too."""

HELD_BYTES = 75_000_000
"""Memory that these arrays hold at most, except briefly; enough for what is worked on together, unless it is large."""

LASTING = Path("/var/tmp")
"""Where Linux keeps large temporary files: `/tmp` is often in memory itself."""

MOUNTS, MEMORY = Path("/proc/self/mountinfo"), Path("/proc/self/statm")

WATCHER = "arrays on disk"
"""Name of the thread."""

_EVERY_S = 0.02
"""Interval between checks, in which a few cores touch some ten megabytes."""


def zeros(shape: tuple[int, ...], dtype: DTypeLike = np.float32, views: int | None = None) -> NDArray:
    """Zeros, on disk if they are of many views and there is room, else in memory; `views` defaults to `shape[0]`."""
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


def chosen(array: NDArray, mask_of: Callable[[int], NDArray]) -> NDArray:
    """(n,) numbers of an array of views, on disk as by `zeros`: those that a view's mask chooses, view by view."""
    ends = np.cumsum([0, *(np.count_nonzero(mask_of(view)) for view in range(len(array)))]).tolist()
    found = zeros((ends[-1],), array.dtype, len(array))
    for view, own in enumerate(array):
        found[ends[view] : ends[view + 1]] = own[mask_of(view)]
    return found


class _Held:
    """Mappings, and the thread that releases their pages; it runs as long as there are mappings."""

    def __init__(self) -> None:
        self._mappings = weakref.WeakSet[mmap.mmap]()
        self._lock = threading.Lock()
        self._watcher: threading.Thread | None = None

    def let_go(self) -> None:
        """Release all their pages; what is touched next comes back."""
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
    """Give memory back after a part of the work: pages of these arrays, and what the C library keeps after frees."""
    _HELD.let_go()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None  # glibc's alone
    if trim is not None:
        trim(0)


def _mapped_bytes(status: FileIO) -> int:
    """Resident memory of this process that maps files."""
    return int(os.pread(status.fileno(), 100, 0).split()[2]) * mmap.PAGESIZE


def room() -> int:
    """Bytes free for such arrays."""
    if not _is_possible():
        return 0
    try:
        disk = os.statvfs(_folder())
    except OSError:
        return 0
    return disk.f_bavail * disk.f_frsize


def _is_possible() -> bool:
    """Where bytes can be reserved, as writing to a full disk would end the process, and files do not lie in memory."""
    is_linux = hasattr(os, "posix_fallocate") and hasattr(mmap, "MADV_DONTNEED") and MEMORY.exists()
    return is_linux and not _is_memory(_folder())


@lru_cache
def _is_memory(folder: str) -> bool:
    """Whether a folder's files lie in memory, as far as Linux knows."""
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
