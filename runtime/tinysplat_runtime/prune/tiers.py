"""Which Gaussians a file's prefix shows: those that pictures need most when all others are gone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..codec.list.levels import LEAST_COUNT, LEVELS, Tiers
from ..gaussian.gaussians import Gaussians
from .removal import Remover, Thinned

GROWTHS = (0.0, 0.14, 0.26, 0.4, 0.56, 0.74, 0.94)
"""What is tried for logarithms of scales where later tiers are absent."""


def tiers_of(remover: Remover, thinned: Thinned) -> Tiers:
    """Tiers of what the remover left; one of few."""
    count = thinned.rows.size
    if count < LEAST_COUNT:
        return Tiers.whole(count)
    numbers = np.full(count, len(LEVELS) - 1, np.uint8)
    growths = []
    for number in range(len(LEVELS) - 2, -1, -1):
        kept = remover.dearest(thinned.rows, int(LEVELS[number].share * count))
        numbers[kept] = number
        growths.append(_growth(remover, thinned.gaussians.taken(kept)))
    return Tiers(LEVELS, numbers, tuple(reversed(growths)))


def _growth(remover: Remover, gaussians: Gaussians) -> float:
    """By which scales of these, when they are all there is, come nearest to pictures of the whole."""
    best, least = 0.0, float("inf")
    for growth in GROWTHS:
        error = remover.error_of(replace(gaussians, scales=gaussians.scales * np.float32(np.exp(growth))))
        if error > least:
            break
        best, least = growth, error
    return best
