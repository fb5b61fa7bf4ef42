"""Planes that are not at hand, and what stands in for them.

A prefix of a file lacks its last planes, a damaged file those whose checksums differ. Whatever the reason, the decoder
treats a plane that is not there in one way, described in docs/FORMAT.md, "Prefixes": its samples are all
`stand_in_code`, and a view without its first depth picture is hidden, since Gaussians at a guessed depth would only
cover what is right.
"""

from __future__ import annotations

from ..container.layers import LayerHeader
from ..container.planes import Planes
from ..gaussian.planes import MAX_CODE, PlaneClass
from .quantise import MID_CODE


def stand_in_code(layer: LayerHeader, channel: int) -> int:
    """The code of every sample of an absent picture of the layer's record `channel`.

    Encoders put a channel's mean at code 2048 where its range allows. A record that refines another one's depth adds
    nothing instead: it takes the code whose value is nearest to 0.
    """
    record = layer.channels[channel]
    is_refinement = record.key in (earlier.key for earlier in layer.channels[:channel])
    if not is_refinement or record.scale == 0:
        return MID_CODE
    return min(max(round(-record.offset / record.scale), 0), MAX_CODE)


def hidden_views(layer: LayerHeader) -> list[int]:
    """Views of the layer whose first depth picture is absent: their Gaussians get opacity 0."""
    first = next((c for c in layer.channels if c.plane_class == PlaneClass.DEPTH), None)
    return [] if first is None else [view for view in range(len(layer.cameras)) if first.lacks(view)]


def first_picture_end(planes: Planes) -> int:
    """Bytes of the smallest prefix that holds a depth picture of layer 0, which must have one."""
    records = planes.layers[0].channels
    return next(c.pictures[0].end for c in records if c.plane_class == PlaneClass.DEPTH and c.pictures)
