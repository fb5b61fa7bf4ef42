"""Scenes for any format with fewer Gaussians: a share of them, a number, or as few as a quality bears."""

from __future__ import annotations

import math
from dataclasses import replace

from ..codec.free.encoder import visible
from ..errors import warn
from ..gaussian.gaussians import Gaussians
from ..system.threads import Crew
from .amount import Amount
from .removal import Remover, Thinned
from .views import views_of

TOLERANCE_DB = 0.3
"""More dB than were asked for that end the search."""

_TRIALS = 8
_DB_PER_DOUBLING = 3.0
"""That pictures lose when a Gaussian's worth doubles, about."""


def leave_out(gaussians: Gaussians, amount: Amount, threads: int) -> Thinned:
    """The Gaussians that pictures need most, as one list.

    Pictures are those of the places that its photos were taken from, where these are known, and beside them; else views
    about it.

    Raises:
        InputError: no Gaussian shows.
    """
    shown = visible(gaussians)
    views, doubt = views_of(shown)
    if doubt:
        warn(f"Gaussians left out by views from outside: {doubt}")
    remover = Remover(shown, views.deciding, Crew(threads).map, views.judging)
    if amount.psnr is not None:
        found = _to_psnr(remover, amount.psnr)
    else:
        wanted = amount.count if amount.count is not None else round((1 - (amount.share or 0)) * gaussians.count)
        found = remover.thin_to(max(min(wanted, shown.count), 1))
    notes = replace(gaussians.notes, thinned=found.text or gaussians.notes.thinned)
    return replace(found, gaussians=found.gaussians.with_notes(notes))


def _to_psnr(remover: Remover, target: float) -> Thinned:
    """With the fewest Gaussians found that have so many dB."""
    worth, best = math.log2(max(remover.worth_at(target), 1e-9)), remover.whole
    tried: list[tuple[float, float]] = []  # worth, in octaves, and dB above those aimed at, either side of it
    for _ in range(_TRIALS):
        found = remover.thin(2**worth)
        over = found.psnr - target
        if over >= 0 and found.left_out > best.left_out:
            best = found
        if 0 <= over <= TOLERANCE_DB:
            break
        above = over - TOLERANCE_DB / 2
        tried = [one for one in tried if (one[1] > 0) != (above > 0)] + [(worth, above)]
        if len(tried) == 2:
            (near, low), (far, high) = tried
            worth = near + (far - near) * min(max(low / (low - high), 0.1), 0.9)
        else:
            worth += above / _DB_PER_DOUBLING
    return best
