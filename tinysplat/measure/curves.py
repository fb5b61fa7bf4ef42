"""Numbers of curves: bytes at equal dB and BD-rate of rate–distortion, slopes and fixed costs of growth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError

LEAST_OVERLAP_DB = 0.5
"""A BD-rate over less says more about the curves' ends than about the codecs."""

PROPORTIONAL = (0.85, 1.15)
"""Slopes between neighbouring points that count as proportional growth."""

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


def decibels_at(points: Iterable[Point], size: float) -> float | None:
    """dB that a curve reaches with at most so many bytes; None below its smallest file."""
    curve, wanted = _curve(points)[:, ::-1], np.log(size)
    if not len(curve) or wanted < curve[0, 0]:
        return None
    return float(_interpolated(curve)(wanted) if wanted < curve[-1, 0] else curve[-1, 1])


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


@dataclass(frozen=True)
class Fit:
    """How a cost y grows with x.

    Attributes:
        slope: of the line through all points in log-log.
        fixed, per_unit: y ≈ fixed + per_unit · x, relative errors weighed alike, neither below 0.
        steps: slopes in log-log between neighbouring points, by the x of the later one.
        linear_from: the smallest x from which on all steps are within `PROPORTIONAL`; None if the last is not.
    """

    slope: float
    fixed: float
    per_unit: float
    steps: tuple[tuple[float, float], ...]
    linear_from: float | None

    @classmethod
    def of(cls, x: Sequence[float], y: Sequence[float]) -> Fit:
        """Fit points of rising x."""
        log_x, log_y = np.log(x), np.log(y)
        slope = float(np.polyfit(log_x, log_y, 1)[0])
        local = np.diff(log_y) / np.diff(log_x)
        linear_from = None
        for i in range(len(local) - 1, -1, -1):
            if not PROPORTIONAL[0] <= local[i] <= PROPORTIONAL[1]:
                break
            linear_from = float(x[i])
        fixed, per_unit = _affine(np.asarray(x, float), np.asarray(y, float))
        steps = tuple((float(later), float(step)) for later, step in zip(x[1:], local, strict=True))
        return cls(slope, fixed, per_unit, steps, linear_from)

    def sentence(self, axis: str, unit: Callable[[float], str], x_first: float) -> str:
        """What the fit says, in words.

        Args:
            axis: what x counts.
            unit: writes a cost.
            x_first: the smallest x measured.
        """
        each = axis.removesuffix("s") if x_first == 1 else f"{x_first:,.0f} {axis}"
        model = f"{unit(self.fixed)} + {unit(self.per_unit * x_first)} for every {each}"
        if self.linear_from is not None and self.linear_from <= x_first:
            return f"in proportion over the whole range ({model})"
        share = self.fixed / (self.fixed + self.per_unit * x_first)
        fixed = f"fixed costs are {share:.0%} of the smallest point's; {model}"
        if self.linear_from is not None:
            return f"in proportion from {self.linear_from:,.0f} {axis} on ({fixed})"
        at, last = self.steps[-1]
        trend = "faster" if last > PROPORTIONAL[1] else "slower"
        return f"{trend} than in proportion up to {at:,.0f} {axis}, slope {last:.2f} there ({fixed})"


def _affine(x: NDArray, y: NDArray) -> tuple[float, float]:
    """a, b ≥ 0 of the least squares of (a + b·x − y) / y."""
    (a, b), *_ = np.linalg.lstsq(np.column_stack([1 / y, x / y]), np.ones_like(y), rcond=None)
    if a < 0:
        return 0.0, float((x / y).sum() / ((x / y) ** 2).sum())
    if b < 0:
        return float((1 / y).sum() / (1 / y**2).sum()), 0.0
    return float(a), float(b)
