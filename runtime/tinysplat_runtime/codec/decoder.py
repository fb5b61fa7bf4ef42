"""A `.tsplat` file's bytes to Gaussians: parsed, what is missing told, and the rest left to the file's mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..container.reader import read_container
from ..container.records import Limits
from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians
from ..graphs.inference import GraphStore
from ..system.stopwatch import Stopwatch
from .layers import OpenFile
from .missing import cut_off_planes, damaged_planes
from .modes.registry import MODES


def decode_gaussians(
    data: bytes,
    store: GraphStore,
    *,
    threads: int,
    limits: Limits | None = None,
    max_bytes: int | None = None,
    views: Sequence[int] | None = None,
    units: Mapping[int, bytes] | None = None,
    lost: list[str] | None = None,
    model: str | None = None,
    watch: Stopwatch | None = None,
) -> Gaussians:
    """Decode a file.

    Args:
        data: the whole file; with `max_bytes`, at least that many of its first bytes.
        store: opens the synthesis graphs.
        threads: planes decoded at a time.
        limits: what to accept.
        max_bytes: decode from this many first bytes alone; `missing` says what stands in for the rest.
        views: decode these views alone, in this order; what is decoded is what it is in the whole file.
        units: sections VIEW of those views, for `data` that holds the metadata alone.
        lost: decode what is intact of a damaged or cut file; filled with the names of the planes that are not, for
            which the same stands in. None refuses such a file.
        model: the network for a file of photos: a path, or a name in the manifest; None to find it by its hash.
        watch: filled with seconds per stage.

    Returns:
        Gaussians with cameras and all layers. A file whose views are units and that is cut or damaged gives the views
        of which there is something.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits; a prefix too short for any picture; with
            `lost`, damaged metadata or no intact depth picture of layer 0.
        InputError: `views` are not different views of the file.
        ModelError: the network that the file names is not at hand.
    """
    watch = watch or Stopwatch()
    with watch.stage("parse"):
        is_prefix = max_bytes is not None or lost is not None
        view, is_damaged = memoryview(data)[:max_bytes], lost is not None
        container = read_container(view, limits, is_prefix=is_prefix, is_damaged=is_damaged, views=views, units=units)
        missing = cut_off_planes(container) if lost is None else damaged_planes(container)
        if lost is not None:
            lost += [f"view {view}" for view in container.absent]
            lost += [container.body.picture_name(*ref) for ref in sorted(missing)]
    opened = OpenFile(container, missing, store, threads, model, watch)
    gaussians = MODES[container.mode].decode(opened, container.body).with_notes(container.notes)
    # Views of some modes need one another, so that all of them had to be decoded.
    return gaussians if views is None or container.body.is_divisible else select_views(gaussians, views)
