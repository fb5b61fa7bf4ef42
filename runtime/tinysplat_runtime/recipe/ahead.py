"""The steps from photos to a file, each with its usual share of the time.

Shares are percentages measured on default captures (docs/lab/seconds.md); a run corrects them as its own steps end.
"""

from __future__ import annotations

from ..codec.modes import EITHER, LIST
from ..gaussian.gaussians import Gaussians
from ..graphs.ways import Way
from ..sparse import usual_steps
from .request import EncodeRequest
from .words import Refinement

Steps = list[tuple[str, float]]

CHECKS: Steps = [("checking photos", 1), ("checking cameras", 2)]

CODED: Steps = [("planning", 2), ("coding planes", 9)]

LISTED: Steps = [
    ("looking at views", 8),
    ("pruning", 12),
    ("correcting", 13),
    ("ranking", 6),
    ("coding", 4),
    ("measuring", 2),
]

SPARED: Steps = [("looking at views", 6), ("coding", 4), ("measuring", 2)]
"""Steps of coding a list that training has pruned."""

AGREED: Steps = [("comparing neighbours", 3)]

LOOKED, REFINED, TRAINED = 4.0, 4.0, 2.2
"""Shares of time: the first look at photos, a step of refinement, and a step of training times the photos."""

REFINED_STEPS = 8
"""Usual steps of refining a capture."""

COMPARED: Steps = [("comparing photos", 3)]


def ahead(
    way: Way, request: EncodeRequest, photos: int, budget: Refinement | None, *, is_compared: bool, is_coded: bool
) -> Steps:
    """All steps of a request, from checks on.

    Args:
        way: through the network.
        request: what was asked for.
        photos: their number.
        budget: for refinement or training; None for neither.
        is_compared: whether photos that the others contradict are looked for.
        is_coded: whether a file is coded and compared with the photos.
    """
    rest = from_network(way, request, photos, budget, is_compared=is_compared, is_coded=is_coded)
    return [*CHECKS, *rest]


def from_network(
    way: Way, request: EncodeRequest, photos: int, budget: Refinement | None, *, is_compared: bool, is_coded: bool
) -> Steps:
    """The steps from the network on; arguments as above."""
    choosing: Steps = []
    if request.mode == EITHER:
        from .contest import STEPS  # needs numba

        choosing = [*refined(None), *_trained(photos, STEPS)]
    agreed = AGREED if is_compared else []
    return [*way.steps, *agreed, *choosing, *from_gaussians(request, photos, budget, is_coded=is_coded)]


def from_gaussians(request: EncodeRequest, photos: int, budget: Refinement | None, *, is_coded: bool) -> Steps:
    """The steps after the network and the choice of a mode; arguments as above."""
    if request.mode == LIST:
        return [*_trained(photos, budget.steps if budget else None), *(SPARED + COMPARED if is_coded else [])]
    return [*(refined(budget) if budget else []), *(CODED + COMPARED if is_coded else [])]


def coded(gaussians: Gaussians) -> Steps:
    """The steps of coding Gaussians."""
    return CODED if gaussians.is_per_pixel else LISTED


def refined(budget: Refinement | None) -> Steps:
    """The steps of refinement; None for the usual budget."""
    steps = budget.steps if budget else None
    return [("looking at photos", LOOKED), ("refining", REFINED * (steps or REFINED_STEPS))]


def _trained(photos: int, steps: int | None) -> Steps:
    return [("training", TRAINED * (steps or usual_steps(photos)) / photos)]
