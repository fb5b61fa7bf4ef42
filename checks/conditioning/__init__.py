"""How much do the transforms lose to rounding, at the ends? Errors of plain float32, of what ships, and of float64,
against 50 digits of mpmath, each row with the bound that it must keep.

    python -m checks.conditioning

prints the tables of docs/NUMERICS.md.
"""

from __future__ import annotations

from collections.abc import Iterator

from tinysplat.measure.rows import Row
from tinysplat_runtime.graphs.inference import GraphStore

from . import pictures, projection, reduction


def numeric_rows(store: GraphStore) -> Iterator[Row]:
    """Rows of all transforms that have a bound."""
    yield from projection.projection_rows(store)
    yield from projection.inverse_rows(store)
    yield from projection.rotation_rows()
    yield from reduction.spectrum_rows()
    yield from pictures.sh_rows()
    yield from pictures.splat_rows()
