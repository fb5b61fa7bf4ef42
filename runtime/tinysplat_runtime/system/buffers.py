"""Memory of results that nobody holds any more, used again.

Fresh memory has to be cleared by the system before it is given to a process: 40 of 370 ms when a layer of 6×512×960
Gaussians is decoded. Who decodes one file after the other and lets go of each gets the same memory again.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray


class _Lease:
    """Lends a buffer to numpy: arrays and all their views keep their lease alive, and its end is the last one's."""

    def __init__(self, buffer: NDArray) -> None:
        self.buffer = buffer

    @property
    def __array_interface__(self) -> dict[str, Any]:
        return self.buffer.__array_interface__


class Recycler:
    """Hands out arrays and takes their memory back by itself; safe to share among threads."""

    def __init__(self) -> None:
        self._free: list[NDArray] = []
        self._most = 0  # numbers kept at most
        self._lock = Lock()

    def empty(self, shapes: Sequence[tuple[int, ...]]) -> list[NDArray]:
        """Arrays of these shapes, float32, with any content.

        Of the memory that has come back, what does not serve them is let go; until the next call no more is kept than
        twice what the largest one asked for (a scene's first layer, and its smaller ones).
        """
        sizes = [math.prod(shape) for shape in shapes]
        with self._lock:
            self._most = max(self._most, 2 * sum(sizes))
            free = [self._free.pop() for _ in range(len(self._free))]
        buffers = []
        for size in sizes:
            fitting = next((i for i, buffer in enumerate(free) if buffer.size == size), None)
            buffers.append(np.empty(size, np.float32) if fitting is None else free.pop(fitting))
        return [self._lend(buffer).reshape(shape) for buffer, shape in zip(buffers, shapes, strict=True)]

    def _lend(self, buffer: NDArray) -> NDArray:
        lease = _Lease(buffer)
        weakref.finalize(lease, self._take_back, buffer).atexit = False
        return np.asarray(lease)

    def _take_back(self, buffer: NDArray) -> None:
        # Without the lock, which would be taken twice where garbage is collected within it: appending is one step to
        # Python's threads, and a buffer too many or too few does no harm.
        if sum(kept.size for kept in self._free) + buffer.size <= self._most:
            self._free.append(buffer)
