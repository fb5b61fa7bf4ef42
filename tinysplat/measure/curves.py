"""Numbers of rate–distortion curves: bytes at equal dB, and BD-rate."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError

LEAST_OVERLAP_DB = 0.5
"""A BD-rate over less says more about the curves' ends than about the codecs."""

Point = tuple[float, float]
"""Bytes of a file, and dB of its pictures."""


def _interpolated(curve: NDArray) -> Any:
    """Monotone cubics through points (N, 2)."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(*curve.T)


def bytes_at(points: Iterable[Point], db: float) -> float | None:
    """Bytes that a curve needs for a PSNR, between its points; None outside them."""
    curve = _curve(points)
    if len(curve) < 2 or not curve[0, 0] <= db <= curve[-1, 0]:
        return None
    return float(np.exp(_interpolated(curve)(db)))


def bd_rate(
    reference: Iterable[Point],
    points: Iterable[Point],
    limits: tuple[float, float] | None = None,
    least_overlap: float = LEAST_OVERLAP_DB,
) -> float:
    """Mean difference of bytes at equal PSNR, as a share of the reference's: −0.5 is half the bytes.

    Bjøntegaard's measure (VCEG-M33) with log bytes over dB interpolated by monotone cubics in place of one polynomial,
    integrated over the range of dB that both curves have.

    Args:
        reference, points: at least two files each.
        limits: dB to integrate between, where the whole overlap is not wanted.
        least_overlap: dB that the curves must have in common.

    Raises:
        InputError: the curves have less in common, or one has a single point.
    """
    curves = [_curve(reference), _curve(points)]
    if min(map(len, curves)) < 2:
        raise InputError("a curve of one point, BD-rate needs two", where="curves")
    low, high = limits or (-np.inf, np.inf)
    for curve in curves:
        low, high = max(low, curve[0, 0]), min(high, curve[-1, 0])
    if high - low < least_overlap:
        raise InputError(f"curves share {max(high - low, 0):.2f} dB, BD-rate needs {least_overlap:g}", where="curves")
    areas = [float(_interpolated(curve).integrate(low, high)) for curve in curves]
    return float(np.expm1((areas[1] - areas[0]) / (high - low)))


def _curve(points: Iterable[Point]) -> NDArray:
    """(n, 2) dB and log bytes, rising in both: of points that others beat in both, none is kept."""
    kept: list[tuple[float, float]] = []
    for size, db in sorted(points, key=lambda p: (p[0], -p[1])):
        if not kept or db > kept[-1][0]:
            kept.append((db, float(np.log(size))))
    return np.array(kept).reshape(-1, 2)
