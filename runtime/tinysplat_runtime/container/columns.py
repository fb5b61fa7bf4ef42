"""Numbers by view, column by column: once where all views have the same, and as float32 where that loses nothing.

Layout: docs/FORMAT.md, "Columns". What is read is what was written, to the bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import layout as L
from .sections import Cursor


def packed_columns(values: NDArray) -> bytes:
    """The bytes of (V, C) float64 numbers."""
    parts = []
    for column in values.T:
        with np.errstate(over="ignore"):
            narrow = column.astype("<f4")
        form = L.NARROW * (narrow.astype(np.float64).tobytes() == column.tobytes())
        stored = narrow if form else column.astype("<f8")
        is_same = stored.tobytes() == stored[:1].tobytes() * len(stored)
        form |= L.PER_VIEW * (not is_same)
        parts += [L.COLUMN.pack(form), (stored[:1] if is_same else stored).tobytes()]
    return b"".join(parts)


def read_columns(cursor: Cursor, views: int, columns: int) -> NDArray:
    """(V, C) float64 numbers, of which nothing is known yet; FormatError where there are too few."""
    values = np.empty((views, columns))
    for column in range(columns):
        (form,) = cursor.unpack(L.COLUMN)
        cursor.require(form <= L.PER_VIEW | L.NARROW, f"a column stored as {form}, known are 0 to 3")
        dtype = np.dtype("<f4" if form & L.NARROW else "<f8")
        count = views if form & L.PER_VIEW else 1
        with np.errstate(invalid="ignore"):  # signalling NaN
            values[:, column] = np.frombuffer(cursor.take(count * dtype.itemsize), dtype)
    return values
