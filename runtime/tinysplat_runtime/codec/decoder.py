"""A `.tsplat` file's bytes to Gaussians."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from threading import Lock, local

import numpy as np
from numpy.typing import NDArray

from ..container.reader import read_container
from ..container.records import ChannelRecord, Container, LayerHeader, Limits
from ..errors import FormatError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..graphs.inference import GraphStore
from ..graphs.predict import predict
from ..system.stopwatch import Stopwatch, part
from ..system.threads import Crew
from .exact import decode_exact
from .hevc import PlaneDecoder
from .missing import (
    PlaneRef,
    cut_off_planes,
    damaged_planes,
    first_picture_end,
    hidden_views,
    plane_name,
    stand_in_code,
)
from .photos import decode_photos
from .residual import check_prediction, predicted_geometry
from .synthesis import LayerSynthesis, coded_channels


def decode_gaussians(
    data: bytes,
    store: GraphStore,
    *,
    threads: int,
    limits: Limits | None = None,
    max_bytes: int | None = None,
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
        max_bytes: decode from this many first bytes alone; `absent` says what stands in for the rest.
        lost: decode what is intact of a damaged or cut file; filled with the names of the planes that are not, for
            which the same stands in. None refuses such a file.
        model: the network for a file of photos: a path, or a name in the manifest; None to find it by its hash.
        watch: filled with seconds per stage.

    Returns:
        Gaussians with cameras and all layers.

    Raises:
        FormatError: damaged, cut short, foreign, or beyond the limits; a prefix too short for any picture; with
            `lost`, damaged metadata or no intact depth picture of layer 0.
        ModelError: the network that the file names is not at hand.
    """
    watch = watch or Stopwatch()
    with watch.stage("parse"):
        is_prefix = max_bytes is not None or lost is not None
        with part("metadata"):
            container = read_container(memoryview(data)[:max_bytes], limits, is_prefix=is_prefix)
        absent = cut_off_planes(container) if lost is None else damaged_planes(container)
        if lost is not None:
            lost += [plane_name(container, ref) for ref in sorted(absent)]
        _check_something_is_left(container, absent)
    return _decode(container, absent, store, threads, model, watch).with_notes(container.notes)


def _decode(
    container: Container,
    absent: Collection[PlaneRef],
    store: GraphStore,
    threads: int,
    model: str | None,
    watch: Stopwatch,
) -> Gaussians:
    """Gaussians of a file of any mode."""
    if container.exact:
        return _decode_exact(container, store, threads, watch)
    prediction = _predict(container, store, threads, model, watch) if container.photos else None
    if prediction is not None and not container.layers:
        return prediction
    layers = []
    crew = Crew(threads)
    for index, layer in enumerate(container.layers):
        with watch.stage("synthesis"):
            base = _base(prediction, index, layer, store)
            with part("metadata"):
                synthesis = LayerSynthesis(layer, container.origin, store, base)
        _decode_layer(_Pictures(container, index), synthesis, crew, absent, watch)
        with watch.stage("synthesis"):
            layers.append(synthesis.gaussians())
        if prediction is None:
            layers[-1].opacities[hidden_views(layer, index, absent)] = 0
    return Gaussians.unchecked(
        **{name: getattr(layers[0], name) for name in FIELDS},
        cameras=container.cameras,
        origin=container.origin,
        extra_layers=tuple(layers[1:]),
    )


def _predict(container: Container, store: GraphStore, threads: int, model: str | None, watch: Stopwatch) -> Gaussians:
    """What the network that the file names makes of its photos."""
    photos, network = container.photos, container.network
    assert photos is not None and network is not None
    with watch.stage("libavcodec"):
        images = decode_photos(photos, container.parameter_sets[photos.parameter_set], threads)
    with watch.stage("network"):
        graph = store.network_by_hash(network.name, network.sha256, model)
        return predict(images, container.cameras, network.near, network.far, graph)


def _base(
    prediction: Gaussians | None, index: int, layer: LayerHeader, store: GraphStore
) -> tuple[NDArray, NDArray] | None:
    """Geometry and SH coefficients that a hybrid file's layer is added to."""
    if prediction is None:
        return None
    if index >= len(prediction.layers):
        raise FormatError(f"the network gives {len(prediction.layers)} layers", where=f"layer {index}")
    check_prediction(layer, prediction.layers[index], index)
    return predicted_geometry(store, prediction.layers[index], f"layer {index}"), prediction.layers[index].sh


def _decode_exact(container: Container, store: GraphStore, threads: int, watch: Stopwatch) -> Gaussians:
    layers = []
    crew = Crew(threads)
    for index, exact in enumerate(container.exact):
        with watch.stage("zlib"):
            geometry, sh = decode_exact(exact, threads)
        # A layer without channels: all that it is stands in the base.
        header = LayerHeader(
            exact.height, exact.width, 0, exact.degree, exact.depth_limits, 0.0, 1.0, True, exact.cameras, None, None,
            None, 0, (),
        )  # fmt: skip
        with watch.stage("synthesis"):
            synthesis = LayerSynthesis(header, container.origin, store, (geometry, sh[..., :1, :]))
            no_codes = np.ones((1, exact.height, exact.width), np.uint16)
            for half in (partial(synthesis.run, geometry=no_codes), partial(synthesis.run, colors=no_codes)):
                crew.map(half, range(len(exact.cameras)))
            layer = synthesis.gaussians()
        fields = {name: getattr(layer, name) for name in FIELDS} | {"sh": sh}
        if not all(np.isfinite(array).all() for array in fields.values()):
            raise FormatError("decodes to numbers beyond float32", where=f"layer {index}")
        layers.append(Gaussians.unchecked(**fields, cameras=exact.cameras, origin=container.origin))
    first = {name: getattr(layers[0], name) for name in FIELDS}
    rest = tuple(layers[1:])
    return Gaussians.unchecked(**first, cameras=container.cameras, origin=container.origin, extra_layers=rest)


def _check_something_is_left(container: Container, absent: Collection[PlaneRef]) -> None:
    if container.mode != "gaussians":
        return
    first = container.layers[0]
    if absent and len(hidden_views(first, 0, absent)) == len(first.cameras):
        end = first_picture_end(container)
        raise FormatError(f"holds no intact depth picture; the first of them ends at byte {end}", where="file")


@dataclass(frozen=True)
class _Pictures:
    """The pictures of layer `index` of a container, and a libavcodec context of each thread's own to decode them."""

    container: Container
    index: int
    own: local = field(default_factory=local)

    @property
    def layer(self) -> LayerHeader:
        return self.container.layers[self.index]

    def decode(self, channel: ChannelRecord, view: int, out: NDArray) -> None:
        """Decode one picture into `out` (H, W) uint16."""
        with part("CRC"):
            payload = self.container.payload(self.index, channel, view)
        if not hasattr(self.own, "decoder"):
            parameter_sets = self.container.parameter_sets[self.layer.parameter_set]
            self.own.decoder = PlaneDecoder(parameter_sets, self.layer.height, self.layer.width)
        try:
            self.own.decoder.decode_into(payload, out)
        except FormatError as error:
            raise FormatError(error.message, where=f"plane {channel.name}, view {view}") from None


class _Part:
    """Planes of one view that are synthesised together: those of geometry, of colour, or both.

    Memory is taken when the first plane is wanted and let go after synthesis, so that only views at work have some.
    """

    def __init__(
        self,
        pictures: _Pictures,
        view: int,
        planes: Mapping[str, Sequence[int]],
        absent: Collection[PlaneRef],
        synthesise: Callable[..., None],
    ) -> None:
        """`planes` are indices of channels by what `synthesise` calls their codes."""
        self._pictures, self._view, self._planes, self._synthesise = pictures, view, planes, synthesise
        self._present, self._stand_ins = [], []
        for name, channels in planes.items():
            for slot, channel in enumerate(channels):
                if PlaneRef(pictures.index, channel, view) in absent:
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
            (channels[channel].streams[self._view].length, partial(self._decode, name, slot, channels[channel]))
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


def _decode_layer(
    pictures: _Pictures, synthesis: LayerSynthesis, crew: Crew, absent: Collection[PlaneRef], watch: Stopwatch
) -> None:
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
        of_view = [task for part in parts for task in _Part(pictures, view, part, absent, synthesis.run).tasks()]
        # Longest first, so that threads finish the last view together.
        tasks += sorted(of_view, key=lambda task: -task[0])
    start = time.perf_counter()
    spent = sum(crew.map(lambda task: task[1](), tasks)) / crew.threads
    watch.add("synthesis", spent)
    watch.add("libavcodec", time.perf_counter() - start - spent)
