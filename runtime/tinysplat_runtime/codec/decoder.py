"""A `.tsplat` file's bytes to Gaussians: read, with what is missing told, and decoded by the file's mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..container.body import Container
from ..container.reader import read_container
from ..container.records import Limits
from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians
from ..graphs.inference import GraphStore
from ..system.stopwatch import Stopwatch
from .layers import OpenFile
from .missing import PlaneRef, missing_planes
from .modes.registry import MODES


@dataclass(frozen=True)
class ReadFile:
    """What is at hand of a file.

    Attributes:
        container: its metadata and pictures.
        missing: pictures that are cut off or damaged, for which something stands in.
        views: those that were asked for; None for all.
    """

    container: Container
    missing: frozenset[PlaneRef]
    views: Sequence[int] | None

    @property
    def lost(self) -> list[str]:
        """Names of the views and pictures that are cut off or damaged."""
        body, table = self.container.body, self.container.table
        absent = [f"view {view}" for view in self.container.absent]
        refs = sorted(self.missing)
        records = [table.layer(ref.layer)[ref.channel] for ref in refs]
        named = zip(refs, records, strict=True)
        return absent + [body.picture_name(ref.layer, record, table.views[ref.view]) for ref, record in named]


def read_file(
    data: bytes,
    limits: Limits | None = None,
    *,
    max_bytes: int | None = None,
    is_damaged: bool = False,
    views: Sequence[int] | None = None,
    fetched: Mapping[int, bytes] | None = None,
) -> ReadFile:
    """Parse a file, and see what is missing.

    Args:
        data: the whole file; with `max_bytes`, at least that many of its first bytes.
        limits: what to accept.
        max_bytes: read this many first bytes alone.
        is_damaged: take what is intact of a damaged or cut file, which is refused else.
        views: read these views alone, in this order; what is decoded is what it is in the whole file.
        fetched: the bytes of those views, for `data` that holds the metadata alone.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits; with `is_damaged`, damaged metadata.
        InputError: `views` are not different views of the file.
    """
    is_prefix = max_bytes is not None or is_damaged
    first = memoryview(data)[:max_bytes]
    container = read_container(first, limits, is_prefix=is_prefix, is_damaged=is_damaged, views=views, fetched=fetched)
    return ReadFile(container, missing_planes(container, is_damaged=is_damaged), views)


def decode_file(
    file: ReadFile, store: GraphStore, *, threads: int, model: str | None = None, watch: Stopwatch | None = None
) -> Gaussians:
    """Decode what was read of a file.

    Args:
        file: what there is of it.
        store: opens the synthesis graphs.
        threads: planes decoded at a time.
        model: the network for a file of photos: a path, or a name in the manifest; None to find it by its hash.
        watch: filled with seconds per stage.

    Returns:
        Gaussians with cameras and all layers. A file in parts by view that is cut or damaged gives the views
        of which there is something.

    Raises:
        FormatError: a damaged picture; nothing that depth can be decoded of in layer 0.
        ModelError: the network that the file names is not at hand.
    """
    container, body = file.container, file.container.body
    opened = OpenFile(container, file.missing, store, threads, model, watch or Stopwatch())
    gaussians = MODES[container.mode].decode(opened, body).with_notes(container.notes)
    # Views of some modes need one another, so that all of them had to be decoded.
    return gaussians if file.views is None or body.is_divisible else select_views(gaussians, file.views)


def decode_gaussians(
    data: bytes, store: GraphStore, *, threads: int, limits: Limits | None = None, model: str | None = None
) -> Gaussians:
    """Read and decode a whole file; arguments and errors of `read_file` and `decode_file`."""
    return decode_file(read_file(data, limits), store, threads=threads, model=model)
