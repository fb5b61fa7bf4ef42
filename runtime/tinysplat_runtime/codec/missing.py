"""Planes that are not at hand: which ones they are, and what stands in for them.

A prefix of a file lacks its last planes, a damaged file those whose checksums differ. Whatever the reason, the decoder
treats a plane that is not there in one way, described in docs/FORMAT.md, "Prefixes": its samples are all
`stand_in_code`, and a view without its first depth picture is hidden, since Gaussians at a guessed depth would only
cover what is right.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from ..container.body import Container
from ..container.layers import LayerHeader
from ..container.planes import Planes
from ..container.records import Picture
from ..errors import FormatError
from ..gaussian.planes import MAX_CODE, PlaneClass
from .quantise import MID_CODE


class PlaneRef(NamedTuple):
    """One picture of a file: its layer, the index of its channel record there, and its view."""

    layer: int
    channel: int
    view: int


def missing_planes(container: Container, *, is_damaged: bool) -> frozenset[PlaneRef]:
    """The pictures that the bytes at hand do not hold to their end; of a file that `is_damaged`, also those whose bytes
    are not those that were written.
    """
    return frozenset(
        PlaneRef(index, number, view)
        for index, channels in container.table.layers.items()
        for number, channel in enumerate(channels)
        for view, picture in enumerate(channel.pictures)
        if not picture.is_whole or (is_damaged and not _is_intact(picture))
    )


def _is_intact(picture: Picture) -> bool:
    try:
        picture.checked("")
    except FormatError:
        return False
    return True


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


def hidden_views(layer: LayerHeader, index: int, absent: Collection[PlaneRef]) -> list[int]:
    """Views of layer `index` whose first depth picture is absent: their Gaussians get opacity 0."""
    first = next((n for n, c in enumerate(layer.channels) if c.plane_class == PlaneClass.DEPTH), None)
    return [] if first is None else [view for view in range(len(layer.cameras)) if (index, first, view) in absent]


def first_picture_end(planes: Planes) -> int:
    """Bytes of the smallest prefix that holds a depth picture of layer 0, which must have one."""
    records = planes.layers[0].channels
    return next(c.pictures[0].end for c in records if c.plane_class == PlaneClass.DEPTH and c.pictures)
