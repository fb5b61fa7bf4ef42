"""Scenes for any format with fewer Gaussians: a share of them, a number, or as few as a quality bears."""

import math
from dataclasses import replace

from ...codec.search import tries
from ...errors import warn
from ...gaussian.gaussians import Gaussians
from ...system.threads import Crew
from ...system.told import NOBODY, Told
from ..views import from_anywhere, views_of
from ..visible import visible
from .amount import Amount
from .removal import Pruned, Remover

TOLERANCE_DB = 0.3
"""More dB than were asked for that end the search."""

_TRIALS = 8
_DB_PER_DOUBLING = 3.0
"""That pictures lose when a Gaussian's worth doubles, about."""


def leave_out(gaussians: Gaussians, amount: Amount, threads: int, told: Told = NOBODY) -> Pruned:
    """The Gaussians that pictures need most, as one list.

    Pictures are those of the places that its photos were taken from, where these are known, and beside them; else views
    about it.

    Raises:
        InputError: no Gaussian shows.
    """
    shown = visible(gaussians)
    views = from_anywhere(views_of(shown), shown)
    if views.doubt:
        warn(f"Gaussians left out by views from outside: {views.doubt}")
    remover = Remover(shown, views.deciding, Crew(threads).map, views.judging, told=told)
    if amount.psnr is not None:
        found = _to_psnr(remover, amount.psnr)
    else:
        wanted = amount.count if amount.count is not None else round((1 - (amount.share or 0)) * gaussians.count)
        found = remover.prune_to(max(min(wanted, shown.count), 1))
    notes = replace(gaussians.notes, pruned=found.text or gaussians.notes.pruned)
    return replace(found, gaussians=found.gaussians.with_notes(notes))


def _to_psnr(remover: Remover, target: float) -> Pruned:
    """With the fewest Gaussians found that have so many dB."""
    octaves = math.log2(max(remover.worth_at(target), 1e-9))
    wanted = target, target + TOLERANCE_DB, _DB_PER_DOUBLING
    found = tries(lambda worth: remover.prune(2**worth), lambda one: one.psnr, *wanted, start=octaves, count=_TRIALS)
    return max((one.data for one in found if one.score >= target), key=lambda one: one.left_out, default=remover.whole)
