"""Rate–distortion curves: bytes at equal dB."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
"""Bytes of a file, and dB of its pictures."""


def bytes_at(points: Iterable[Point], db: float) -> float | None:
    """Bytes that a curve needs for a PSNR, between its points; None outside them."""
    from scipy.interpolate import PchipInterpolator

    curve = _curve(points)
    if len(curve) < 2 or not curve[0, 0] <= db <= curve[-1, 0]:
        return None
    return float(np.exp(PchipInterpolator(*curve.T)(db)))


def _curve(points: Iterable[Point]) -> NDArray:
    """(n, 2) dB and log bytes, rising in both: of points that others beat in both, none is kept."""
    kept: list[tuple[float, float]] = []
    for size, db in sorted(points, key=lambda p: (p[0], -p[1])):
        if not kept or db > kept[-1][0]:
            kept.append((db, float(np.log(size))))
    return np.array(kept).reshape(-1, 2)
