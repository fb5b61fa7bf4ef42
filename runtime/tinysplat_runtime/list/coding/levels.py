"""Tiers of Gaussians: what a prefix of a file shows first.

A tier costs its Gaussians' positions a bit or so each, as they lie farther apart, and gives it back: what pictures need
most bears finer steps than the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Level:
    """How a tier is made.

    Attributes:
        share: of the Gaussians, with those of the tiers before it.
        steps: of its channels, over those that Q_g says.
        cell: of its grid, the same.
    """

    share: float
    steps: float
    cell: float


LEVELS = (Level(0.04, 0.7, 0.75), Level(0.135, 0.8, 0.8), Level(1, 1.1, 1))
"""Of a scene of enough Gaussians."""

WHOLE = (Level(1, 1, 1),)
"""Of any other one."""

LEAST_COUNT = 10_000
"""Gaussians that are worth levels: of fewer, the whole is soon there."""


@dataclass(frozen=True)
class Tiers:
    """Gaussians by tier.

    Attributes:
        levels: how each is coded.
        numbers: (N,) which one a Gaussian is of.
        growths: of each but the first, what is added to logarithms of scales before it where it is absent.
    """

    levels: tuple[Level, ...]
    numbers: NDArray
    growths: tuple[float, ...]

    @classmethod
    def whole(cls, count: int) -> Tiers:
        """All in one."""
        return cls(WHOLE, np.zeros(count, np.uint8), ())

    def of(self, rows: NDArray) -> Tiers:
        """Tiers of some of the Gaussians, rows (n,) bool; a single one where a tier would be empty."""
        numbers = self.numbers[rows]
        is_full = len(np.unique(numbers)) == len(self.levels)
        return Tiers(self.levels, numbers, self.growths) if is_full else Tiers.whole(len(numbers))
