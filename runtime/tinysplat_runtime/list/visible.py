"""Which Gaussians of a list a file keeps: those that a renderer shows, and not so far out that others would suffer."""

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, warn
from ..gaussian.gaussians import FIELDS, Gaussians
from ..system import disk
from .coding.grid import BULK

LEAST_OPACITY = 1 / 255
"""Below it a Gaussian is not drawn by any renderer, and left out."""

LOST = 1e8
"""Distance from the middle of the bulk, in its radii, from which positions have no room for both."""

MAX_VALUE = 1e30
"""Largest number of a mean, a scale or an SH coefficient that is looked at: as large as a decoded one may be."""


def visible(gaussians: Gaussians) -> Gaussians:
    """As one list, without those that no renderer shows; errors as those of `visible_rows`."""
    rows = visible_rows(flat := gaussians.flat())
    return taken(flat, np.flatnonzero(rows))


def visible_rows(gaussians: Gaussians) -> NDArray:
    """Which of (N,) Gaussians are kept, (N,) bool; those that lie too far out are said.

    Raises:
        InputError: no Gaussian shows; or numbers beyond what a file can hold.
    """
    for name in ("means", "scales", "sh"):
        largest = float(np.abs(getattr(gaussians, name)).max())
        if largest > MAX_VALUE:
            raise InputError(f"numbers of up to {largest:.3g}, accepted is at most {MAX_VALUE:g}", where=name)
    is_shown = gaussians.opacities >= LEAST_OPACITY
    if not is_shown.any():
        raise InputError(f"none of at least {LEAST_OPACITY:.4f}: there is nothing to show", where="opacities")
    means = gaussians.means[is_shown]
    low, high = np.percentile(means.astype(np.float64), BULK, axis=0)
    bulk = max(float(np.linalg.norm(high - low)) / 2, float(np.median(gaussians.scales[is_shown].max(axis=1))))
    is_lost = np.abs(means - (low + high) / 2).max(axis=1) > LOST * bulk
    if is_lost.any() and bulk:
        warn(f"{int(is_lost.sum())} Gaussians lie more than {LOST:g} times as far out as most and are left out")
        is_shown[is_shown] = ~is_lost
    return is_shown


def taken(gaussians: Gaussians, rows: NDArray) -> Gaussians:
    """Rows (n,) integer of a list, rising, on disk where there are many."""
    if len(rows) == gaussians.count:
        return gaussians
    fields = {}
    for name in FIELDS:
        values = getattr(gaussians, name)
        fields[name] = disk.zeros((len(rows), *values.shape[1:]), views=len(rows))
        np.take(values, rows, axis=0, out=fields[name], mode="clip")  # in other modes numpy makes a copy first
    return gaussians.changed(**fields)
