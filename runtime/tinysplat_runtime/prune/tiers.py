"""Which Gaussians a file's prefix shows: those that pictures need most when all others are gone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..codec.free.levels import LEAST_COUNT, LEVELS, Tiers
from ..gaussian.gaussians import Gaussians
from .removal import Remover, taken

ROUNDS = (0.7, 1.0)
"""How much of what a tier does not hold is gone after each ranking."""

GROWTHS = (0.0, 0.14, 0.26, 0.4, 0.56)
"""What is tried for logarithms of scales where later tiers are absent."""


def tiers_of(remover: Remover, gaussians: Gaussians) -> Tiers:
    """Tiers of Gaussians that are some of the remover's; one of few."""
    count = gaussians.count
    if count < LEAST_COUNT:
        return Tiers.whole(count)
    numbers = np.full(count, len(LEVELS) - 1, np.uint8)
    kept = np.arange(count)
    growths = []
    for number in range(len(LEVELS) - 2, -1, -1):
        more = len(kept) - int(LEVELS[number].share * count)
        wanted = [len(kept) - int(more * part) for part in ROUNDS]
        for left in wanted:
            costs = remover.costs(taken(gaussians, kept))
            kept = kept[np.sort(np.argsort(costs, kind="stable")[len(kept) - left :])]
        numbers[kept] = number
        growths.append(_growth(remover, taken(gaussians, kept)))
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
