"""Arrays of captures on disk, of which memory holds what is being worked on.

What is known of a capture grows with its photos, and is gone through view by view. Such arrays lie in files without
names, mapped into memory; `set_aside` says that nobody works on them for now, and a `Shelf` knows which views' parts
were worked on last. They can be used like any others.
"""

from __future__ import annotations

import math
import mmap
import os
import tempfile
import threading
from collections import defaultdict
from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

TOGETHER = 6
"""Arrays of up to so many views are worked on as a whole, and stay in memory."""

LEAST_BYTES = 1 << 22
"""Smaller arrays stay there too."""

SHELF_BYTES = 400_000_000
"""What a shelf keeps in memory: more than what is worked on together, unless it is large."""

LASTING = Path("/var/tmp")
"""Where Linux has large files that nobody keeps: often `/tmp` is memory itself."""

MOUNTS = Path("/proc/self/mountinfo")

_EVERY_S = 0.01

_AROUND = 1 << 16
"""Bytes about what is read of a mapping that Linux maps along with it, at most."""


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
    return np.frombuffer(mapped, dtype).reshape(shape)


def set_aside(*arrays: NDArray) -> None:
    """Give back the memory of arrays, or of those that they are parts of, as far as they lie on disk.

    They keep what they hold; another thread that works on them at the same time only reads it again.
    """
    for array in arrays:
        mapped = _mapping(array)
        if mapped is not None:
            mapped.madvise(mmap.MADV_DONTNEED)


def by_view(array: NDArray) -> Iterator[NDArray]:
    """The views of an array one after the other, each set aside when the next is asked for."""
    for view in array:
        yield view
        set_aside(view)


class Shelf:
    """Parts of such arrays by whom they belong to, of which memory holds those that were taken last."""

    def __init__(self, most_bytes: int = SHELF_BYTES) -> None:
        """`most_bytes` stay in memory, or what is taken together if that is more."""
        self._most, self._taken = most_bytes, dict[Hashable, int]()  # bytes, whoever was taken longest ago first
        self._parts = defaultdict[Hashable, list[_Mapped]](list)

    def put(self, owner: Hashable, *parts: NDArray) -> None:
        """Contiguous parts of arrays become an owner's; of those that lie in memory alone nothing is kept."""
        self._parts[owner].extend(own for part in parts if (own := _Mapped.of(part)) is not None)
        self.take((owner,))

    def take(self, owners: Sequence[Hashable]) -> None:
        """These are worked on next; what was not taken for the longest time is set aside for them."""
        for owner in owners:
            self._taken.pop(owner, None)  # goes to the end
            self._taken[owner] = sum(part.size for part in self._parts[owner])
        held = sum(self._taken.values())
        for owner in list(self._taken)[: len(self._taken) - len(owners)]:
            if held <= self._most:
                break
            held -= self._taken.pop(owner)
            for part in self._parts[owner]:
                part.set_aside()


@dataclass(frozen=True, eq=False)
class _Mapped:
    """Bytes of a mapping, from `start` on, with what is brought to memory along with them."""

    mapping: mmap.mmap
    start: int
    size: int

    @classmethod
    def of(cls, array: NDArray) -> _Mapped | None:
        """What a contiguous array takes of its mapping; None where it lies in memory alone."""
        mapping = _mapping(array)
        if mapping is None or not array.size:
            return None
        first = array.ctypes.data - np.frombuffer(mapping, np.uint8).ctypes.data
        start = max(first // _AROUND - 1, 0) * _AROUND
        return cls(mapping, start, min(first + array.nbytes + _AROUND, len(mapping)) - start)

    def set_aside(self) -> None:
        self.mapping.madvise(mmap.MADV_DONTNEED, self.start, self.size)


@contextmanager
def passing(array: NDArray) -> Iterator[None]:
    """While something goes once through all of an array, set aside what it has passed, again and again."""
    if _mapping(array) is None:
        yield
        return
    is_over = threading.Event()

    def follow() -> None:
        while not is_over.wait(_EVERY_S):
            set_aside(array)

    follower = threading.Thread(target=follow, daemon=True)
    follower.start()
    try:
        yield
    finally:
        is_over.set()
        follower.join()
        set_aside(array)


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
    return hasattr(os, "posix_fallocate") and hasattr(mmap, "MADV_DONTNEED") and not _is_memory(_folder())


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


def _mapping(array: NDArray) -> mmap.mmap | None:
    base: Any = array
    while isinstance(base, (np.ndarray, memoryview)):
        base = base.base if isinstance(base, np.ndarray) else base.obj
    return base if isinstance(base, mmap.mmap) else None
