"""Which Gaussians a file's prefix shows: those that pictures need most when all others are gone."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...gaussian.gaussians import Gaussians
from ...system import disk
from ..coding.levels import LEAST_COUNT, LEVELS, Tiers
from ..views import Views
from .removal import Pruned, Remover

LOOKED_FROM, JUDGED_FROM, RANKED = 12, 6, 0.5
"""Views that rank what none is to go of, and that tell its growths; and the share of those present that is ranked at
once, as prices are not needed."""

GROWTHS = (0.0, 0.14, 0.26, 0.4, 0.56, 0.74, 0.94)
"""What is tried for logarithms of scales where later tiers are absent."""


def tiers_of(blocks: Sequence[tuple[Remover | None, Pruned]]) -> Tiers:
    """Tiers of what removers left, block by block; one of few. What nobody removed from comes last."""
    counts = [pruned.rows.size for _, pruned in blocks]
    if sum(counts) < LEAST_COUNT:
        return Tiers.whole(sum(counts))
    found = []
    for block in blocks:
        found.append(_tiers_of(*block))
        disk.let_go()
    growths = np.average([tiers.growths for tiers in found], axis=0, weights=counts)
    return Tiers(LEVELS, np.concatenate([tiers.numbers for tiers in found]), tuple(growths.tolist()))


def ranked(gaussians: Gaussians, views: Views, run_jobs: Callable) -> Tiers:
    """Tiers of (N,) Gaussians of which none is to go, by a look from some of the views; one of few.

    Each is of opacity 1/255 or more. `run_jobs` maps a function over a list, on any number of threads.
    """
    if gaussians.count < LEAST_COUNT or not views.deciding:
        return Tiers.whole(gaussians.count)
    remover = Remover(gaussians, views.some(LOOKED_FROM), run_jobs, views.judging[:JUDGED_FROM], share=RANKED)
    return tiers_of([(remover, remover.whole)])


def _tiers_of(remover: Remover | None, pruned: Pruned) -> Tiers:
    count, growths = pruned.rows.size, list[float]()
    numbers = np.full(count, len(LEVELS) - 1, np.uint8)
    if remover is None:
        return Tiers(LEVELS, numbers, (0.0,) * (len(LEVELS) - 1))
    for number in range(len(LEVELS) - 2, -1, -1):
        kept = remover.costliest(pruned.rows, int(LEVELS[number].share * count))
        numbers[kept] = number
        growths.append(_growth(remover, pruned.gaussians.taken(kept)) if kept.size else 0.0)
    return Tiers(LEVELS, numbers, tuple(reversed(growths)))


def _growth(remover: Remover, gaussians: Gaussians) -> float:
    """By which scales of these, when they are all there is, come nearest to pictures of the whole."""
    best, most = 0.0, -math.inf
    for growth in GROWTHS:
        psnr = remover.psnr_of(replace(gaussians, scales=gaussians.scales * np.float32(np.exp(growth))))
        if psnr < most:
            break
        best, most = growth, psnr
    return best
