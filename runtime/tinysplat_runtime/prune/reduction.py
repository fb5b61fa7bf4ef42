"""Scenes for any format with fewer Gaussians: a share of them, a number, or as few as a quality bears."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from ..codec.free.encoder import visible
from ..gaussian.gaussians import Gaussians
from ..render.paths import between
from ..scene.cameras import Camera
from ..system.threads import Crew
from .amount import Amount
from .removal import Remover, Thinned
from .thinning import VIEWS
from .views import SIDE, views_about

TOLERANCE_DB = 0.3
"""More dB than were asked for that end the search."""

_TRIALS = 8
_DB_PER_DOUBLING = 3.0
"""That pictures lose when a Gaussian's worth doubles, about."""


def leave_out(gaussians: Gaussians, amount: Amount, threads: int) -> Thinned:
    """The Gaussians that pictures need most, as one list.

    Pictures are those that its own cameras would take on a path through all of them; without cameras, views about it.

    Raises:
        InputError: no Gaussian shows.
    """
    shown = visible(gaussians)
    cameras = _on_the_way(gaussians.cameras) if gaussians.cameras else views_about(shown, VIEWS)
    remover = Remover(shown, cameras, Crew(threads).map)
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


def _on_the_way(cameras: Sequence[Camera]) -> list[Camera]:
    """Views on the path through cameras, no larger than those about a scene."""
    path = between(cameras, max(VIEWS, len(cameras)))
    factor = min(SIDE / max(path[0].width, path[0].height), 1)
    size = max(round(path[0].height * factor), 1), max(round(path[0].width * factor), 1)
    return [camera.resized(*size) for camera in path]
