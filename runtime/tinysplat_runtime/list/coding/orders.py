"""Who comes where in a plane: along the curve, but Gaussians that weigh alike together.

An error shows in proportion to how large and opaque its Gaussian is. Channels are coded with steps to match, by classes
of that weight; a class stands in one piece, as a picture whose pixels each have a step of their own would be noise. The
classes follow from channels that are decoded already, by comparisons of numbers that every decoder computes alike, and
cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...container.list import ListChannel, WeightClasses
from .planes import from_plane


@dataclass(frozen=True)
class Order:
    """Places and gains of N Gaussians.

    Attributes:
        rows: (N,) which Gaussian, by the curve, comes where.
        gains: (N,) float64 by the curve.
    """

    rows: NDArray
    gains: NDArray


@dataclass(frozen=True)
class Numbers:
    """A channel's numbers by the curve, which are made as they are asked for: codes take a quarter of their memory.

    The order of other channels hangs on these very numbers, so FORMAT.md fixes every rounding.

    Attributes:
        codes: (N,) integer by the curve; None for a constant.
        scale, offset, centre: a number is (code · scale + offset) · gain + centre.
        gains: (N,) float64 by the curve.
    """

    codes: NDArray | None
    scale: float
    offset: float
    gains: NDArray
    centre: float

    @classmethod
    def of(cls, channel: ListChannel, codes: NDArray | None, order: Order) -> Numbers:
        """Those of a picture of codes, or of a constant."""
        record = channel.record
        if codes is not None:
            by_curve = np.empty(len(order.rows), codes.dtype)
            by_curve[order.rows] = from_plane(codes, len(order.rows))
            codes = by_curve
        return cls(codes, record.scale, record.offset, order.gains, channel.centre)

    @classmethod
    def alike(cls, count: int, value: float) -> Numbers:
        """All of them the same."""
        return cls(None, 0.0, 0.0, np.ones(count), value)

    def __getitem__(self, rows: slice) -> NDArray:
        """Some of them, float64."""
        gains = self.gains[rows]
        if self.codes is None:
            return self.offset * gains + self.centre
        numbers = self.codes[rows].astype(np.float64)
        numbers *= self.scale
        numbers += self.offset
        numbers *= gains
        numbers += self.centre
        return numbers


def along_the_curve(count: int) -> Order:
    """The order of channels that no other says anything about."""
    return Order(np.arange(count), np.ones(count))


def reached(determinant: NDArray, thresholds: NDArray) -> NDArray:
    """(N,) uint16, how many rising thresholds the Gaussians reach by a channel (N,) float64."""
    return np.searchsorted(thresholds.astype(np.float64), determinant, side="right").astype(np.uint16)


def classes_of(counts: NDArray, first: int, number: int) -> NDArray:
    """(N,) uint8 class, 0 to number − 1, of Gaussians that reach so many thresholds, uint16."""
    by_count = np.clip((np.arange(int(counts.max()) + 1) >> 1) - first, 0, number - 1).astype(np.uint8)
    return by_count[counts]


def order_by(counts: NDArray, weights: WeightClasses) -> Order:
    """The order of Gaussians whose determinants reach `counts` thresholds, (N,) integers."""
    classes = classes_of(counts, weights.first, len(weights.gains))
    return Order(np.argsort(classes, kind="stable"), np.array(weights.gains, np.float64)[classes])


def choose_classes(counts: NDArray, logs: NDArray, most: int = 7) -> WeightClasses:
    """Classes about the middle of what there is.

    Args:
        counts: (N,) int64 thresholds reached, half an octave of weight apart.
        logs: (N,) float log2 of the weights, whose mean gets the gain 1.
        most: classes; what weighs more or less than they span goes to the outer ones.
    """
    halves = counts >> 1
    middle = int(np.rint(halves.mean()))
    first = max(middle - most // 2, 0)
    classes = classes_of(counts, first, most)
    members = np.bincount(classes, minlength=most)
    sums = np.bincount(classes, weights=logs - logs.mean(), minlength=most)
    half = most / 2
    gains = np.exp2(-np.clip(sums / np.maximum(members, 1), -half, half)).astype(np.float32)
    return WeightClasses(first, tuple(gains.tolist()))
