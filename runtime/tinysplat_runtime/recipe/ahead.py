"""The steps from photos to a file, each with its usual share of the time.

Shares are percentages measured on default captures (docs/lab/seconds.md); a run corrects them as its own steps end.
"""

from __future__ import annotations

from ..gaussian.gaussians import Gaussians
from ..list.training import usual_steps
from ..modes import LIST
from ..network.ways import Way
from .request import EncodeRequest

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

TRAINED = 2.2
"""Share of time of a step of training, times the photos."""

COMPARED: Steps = [("comparing photos", 3)]


def ahead(way: Way, request: EncodeRequest, photos: int, *, is_compared: bool, is_coded: bool) -> Steps:
    """All steps of a request, from checks on.

    Args:
        way: through the network.
        request: what was asked for, with a mode.
        photos: their number.
        is_compared: whether photos that the others contradict are looked for.
        is_coded: whether a file is coded and compared with the photos.
    """
    return [*CHECKS, *from_network(way, request, photos, is_compared=is_compared, is_coded=is_coded)]


def from_network(way: Way, request: EncodeRequest, photos: int, *, is_compared: bool, is_coded: bool) -> Steps:
    """The steps from the network on; arguments as above."""
    is_list = request.mode == LIST
    coding = (SPARED if is_list else CODED) + COMPARED if is_coded else []
    return [*way.steps, *(AGREED if is_compared else []), *(_trained(request, photos) if is_list else []), *coding]


def coded(gaussians: Gaussians) -> Steps:
    """The steps of coding Gaussians."""
    return CODED if gaussians.is_per_pixel else LISTED


def _trained(request: EncodeRequest, photos: int) -> Steps:
    steps = request.train.steps if request.train else None
    return [("training", TRAINED * (steps or usual_steps(photos)) / photos)]
