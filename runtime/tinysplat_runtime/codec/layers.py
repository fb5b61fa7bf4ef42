"""Layers of coded planes to Gaussians: pictures decoded on all threads, views synthesised as soon as they are whole.

A prefix of a file lacks its last planes, a damaged file those whose checksums differ. Whatever the reason, a plane that
is not there is treated in one way, described in docs/FORMAT.md, "Prefixes": its samples are all `stand_in_code`, and a
view without its first depth picture is hidden, since Gaussians at a guessed depth would only cover what is right.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from threading import Lock, local

import numpy as np
from numpy.typing import NDArray

from ..container.body import Container
from ..container.layers import LayerHeader
from ..container.planes import Planes
from ..container.records import ChannelRecord
from ..errors import FormatError
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import MAX_CODE, PlaneClass
from ..graphs.inference import GraphStore
from ..system.stopwatch import Stopwatch
from ..system.threads import Crew
from ..system.told import NOBODY, Told
from .hevc import PlaneDecoder
from .quantise import MID_CODE
from .synthesis import LayerSynthesis, coded_channels


@dataclass(frozen=True)
class OpenFile:
    """A parsed file, and what it is decoded with.

    Attributes:
        container: its metadata and pictures.
        store: opens graphs.
        threads: planes decoded at a time.
        model: the network for a file of photos, by path or name; None to find it by its hash.
        watch: takes seconds per stage.
        told: who is told how many pictures are decoded.
    """

    container: Container
    store: GraphStore
    threads: int
    model: str | None
    watch: Stopwatch
    told: Told = NOBODY


def decode_layers(file: OpenFile, planes: Planes) -> Gaussians:
    """All layers of coded planes; views whose depth is missing are hidden."""
    layers, crew = [], Crew(file.threads)
    for index, header in enumerate(planes.layers):
        with file.watch.stage("synthesis"):
            synthesis = LayerSynthesis(header, file.container.origin, file.store)
        _decode_layer(_Pictures(file, header, index), synthesis, crew)
        with file.watch.stage("synthesis"):
            layers.append(synthesis.gaussians())
        layers[-1].opacities[hidden_views(header)] = 0
    return Gaussians.stacked(layers).changed(cameras=file.container.cameras)


@dataclass(frozen=True)
class _Pictures:
    """The pictures of layer `index` of a file, and a libavcodec context of each thread's own to decode them."""

    file: OpenFile
    layer: LayerHeader
    index: int
    own: local = field(default_factory=local)

    def decode(self, channel: ChannelRecord, view: int, out: NDArray) -> None:
        """Decode one picture into `out` (H, W) uint16."""
        container = self.file.container
        payload = container.table.payload(channel, view)
        if not hasattr(self.own, "decoder"):
            parameter_sets = container.parameter_sets[self.layer.parameter_set]
            self.own.decoder = PlaneDecoder(parameter_sets, self.layer.height, self.layer.width)
        try:
            self.own.decoder.decode_into(payload, out)
        except FormatError as error:
            where = f"plane {channel.name}, view {container.table.views[view]}"
            raise FormatError(error.message, where=where) from None


class _Part:
    """Planes of one view that are synthesised together: those of geometry, of colour, or both.

    Memory is taken when the first plane is wanted and let go after synthesis, so that only views at work have some.
    """

    def __init__(
        self, pictures: _Pictures, view: int, planes: Mapping[str, Sequence[int]], synthesise: Callable[..., None]
    ) -> None:
        """`planes` are indices of channels by what `synthesise` calls their codes."""
        self._pictures, self._view, self._planes, self._synthesise = pictures, view, planes, synthesise
        self._present, self._stand_ins = [], []
        for name, channels in planes.items():
            for slot, channel in enumerate(channels):
                if pictures.layer.channels[channel].lacks(view):
                    self._stand_ins.append((name, slot, stand_in_code(pictures.layer, channel)))
                else:
                    self._present.append((name, slot, channel))
        self._waiting = max(len(self._present), 1)
        self._codes: dict[str, NDArray] | None = None
        self._lock = Lock()

    def tasks(self) -> list[tuple[int, Callable[[], float]]]:
        """What there is to do, as (bytes to decode, a call that returns the seconds it spent on synthesis)."""
        if not self._present:
            return [(0, self._finish)]
        channels = self._pictures.layer.channels
        return [
            (channels[channel].pictures[self._view].length, partial(self._decode, name, slot, channels[channel]))
            for name, slot, channel in self._present
        ]

    def _decode(self, name: str, slot: int, channel: ChannelRecord) -> float:
        with self._lock:
            if self._codes is None:
                self._codes = self._new_codes()
        self._pictures.decode(channel, self._view, self._codes[name][slot])
        return self._finish()

    def _finish(self) -> float:
        """Synthesise if this was the last plane."""
        with self._lock:
            self._waiting -= 1
            if self._waiting:
                return 0.0
        start = time.perf_counter()
        self._synthesise(self._view, **(self._codes or self._new_codes()))
        self._codes = None
        return time.perf_counter() - start

    def _new_codes(self) -> dict[str, NDArray]:
        grid = (self._pictures.layer.height, self._pictures.layer.width)
        codes = {name: np.empty((len(channels) + 1, *grid), np.uint16) for name, channels in self._planes.items()}
        for array in codes.values():
            array[-1] = 1
        for name, slot, code in self._stand_ins:
            codes[name][slot] = code
        return codes


def _decode_layer(pictures: _Pictures, synthesis: LayerSynthesis, crew: Crew) -> None:
    """Decode all pictures of a layer, and synthesise what is complete beside it.

    The seconds of both stages are those of all threads by the number of threads, as they overlap.
    """
    geometry, colors = coded_channels(pictures.layer)
    planes = {"geometry": geometry, "colors": colors}
    # Several threads share halves of views out more evenly; one is spared what a run of the graph costs whatever its
    # size (0.12 ms, and as much to bind its tensors: 4 % of decoding 2×256×256).
    parts = [planes] if crew.threads == 1 else [{name: channels} for name, channels in planes.items()]
    tasks = []
    for view in range(len(pictures.layer.cameras)):
        of_view = [task for part in parts for task in _Part(pictures, view, part, synthesis.run).tasks()]
        # Longest first, so that threads finish the last view together.
        tasks += sorted(of_view, key=lambda task: -task[0])
    start = time.perf_counter()
    run_jobs = pictures.file.told.counted("decoding pictures", crew.map)
    spent = sum(run_jobs(lambda task: task[1](), tasks)) / crew.threads
    pictures.file.watch.add("synthesis", spent)
    pictures.file.watch.add("libavcodec", time.perf_counter() - start - spent)


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
