"""A `.tsplat` file's bytes to Gaussians: read, and decoded by the file's mode."""

from ..codec.layers import OpenFile
from ..container.body import Container
from ..container.limits import Limits
from ..container.reader import read_container
from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians
from ..graphs.inference import GraphStore
from ..system.stopwatch import Stopwatch
from ..system.told import NOBODY, Told
from .mode import find_mode


def decode_file(
    container: Container,
    store: GraphStore,
    *,
    threads: int,
    model: str | None = None,
    watch: Stopwatch | None = None,
    told: Told = NOBODY,
) -> Gaussians:
    """Decode what was read of a file.

    Args:
        container: what there is of it.
        store: opens the synthesis graphs.
        threads: planes decoded at a time.
        model: the network for a file of photos: a path, or a name in the manifest; None to find it by its hash.
        watch: filled with seconds per stage.
        told: who is told how many pictures are decoded.

    Returns:
        Gaussians with cameras and all layers.

    Raises:
        FormatError: a damaged picture; nothing that depth can be decoded of in layer 0.
        ModelError: the network that the file names is not at hand.
    """
    opened = OpenFile(container, store, threads, model, watch or Stopwatch(), told)
    gaussians = find_mode(container.mode).decode(opened, container.body).with_notes(container.notes)
    return gaussians if container.chosen is None else select_views(gaussians, container.chosen)


def decode_gaussians(
    data: bytes, store: GraphStore, *, threads: int, limits: Limits | None = None, model: str | None = None
) -> Gaussians:
    """Read and decode a whole file; arguments and errors of `read_container` and `decode_file`."""
    return decode_file(read_container(data, limits), store, threads=threads, model=model)
