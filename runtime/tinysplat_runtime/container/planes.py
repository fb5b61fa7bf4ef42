"""Body `Planes`, of mode gaussians: layers of coded planes, their sections read, written and described."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

from ..gaussian.planes import BACK_TO_FRONT, CODING_ORDER, PASSES, PlaneClass
from ..scene.cameras import Camera
from ..system.jsonfields import JsonObject
from . import layout as L
from .body import Body, Description, Opened, check_totals
from .bounds import check_ranges, decoding_bytes
from .layers import CodedLayer, LayerHeader, layer_section, read_layer
from .records import ChannelRecord
from .sections import NewSection
from .table import Row
from .writer import Head, write_container


@dataclass(frozen=True, kw_only=True)
class Planes(Body):
    """Layers of coded planes.

    Attributes:
        layers: metadata, the network's per-pixel layer first.
    """

    mode: ClassVar[str] = "gaussians"
    sign: ClassVar[bytes] = L.LAYER
    kinds: ClassVar[frozenset[bytes]] = frozenset({L.CAMERAS, L.LAYER, L.PARAMETER_SETS})
    is_divisible: ClassVar[bool] = True

    layers: tuple[LayerHeader, ...]

    @classmethod
    def read(cls, file: Opened) -> Planes:
        """Parse and check the sections LAYR."""
        file.check_counts()
        file.check_rows(CODING_ORDER)
        layers, gaussians, memory = [], 0, 0
        for index in range(file.layer_count):
            layer, where = read_layer(file, index), file.only(L.LAYER, index).label
            gaussians += layer.gaussians
            memory += decoding_bytes(layer)
            check_totals(gaussians, memory, file.limits, where)
            check_ranges(layer, file.origin, where)
            layers.append(layer)
        return cls(cameras=file.cameras, layers=tuple(layers))

    @staticmethod
    def step(layer: int, record: ChannelRecord, number: int) -> Hashable:
        """Rows of one pass show together."""
        return pass_of(record.plane_class, number)

    def describe(self) -> Description:
        """Gaussians, layers, and what was left out of them."""
        return Description(
            gaussians=sum(layer.gaussians for layer in self.layers),
            sh_degree=self.layers[0].degree,
            k=self.layers[0].k,
            layers=tuple(_described(layer) for layer in self.layers),
            left_out=tuple(entry for index, layer in enumerate(self.layers) for entry in _left_out(index, layer)),
        )


def pass_of(plane_class: PlaneClass, number: int) -> int:
    """The pass that the class's record `number` belongs to; never falls from record to record."""
    facts = plane_class.facts
    return facts.passes[0] if number < facts.base else facts.passes[1]


def planes_file(head: Head, layers: Sequence[CodedLayer]) -> bytes:
    """The file of coded layers."""
    return write_container(head, _sections(layers, head.cameras), list(_rows(layers)), len(layers))


def _sections(layers: Sequence[CodedLayer], cameras: Sequence[Camera]) -> list[NewSection]:
    """The metadata of layers, and their parameter sets."""
    sets = list(dict.fromkeys(layer.parameter_sets for layer in layers))
    sections = [layer_section(layer, n, sets.index(layer.parameter_sets), cameras) for n, layer in enumerate(layers)]
    return sections + [NewSection(L.PARAMETER_SETS, index, data) for index, data in enumerate(sets) if data]


def _rows(layers: Sequence[CodedLayer]) -> Iterator[Row]:
    """Channels in the order in which a picture gets better from pass to pass."""
    for number in PASSES:
        ordered = list(enumerate(layers))[:: -1 if number == BACK_TO_FRONT else 1]
        for (index, layer), plane_class in product(ordered, CODING_ORDER):
            of_class = [channel for channel in layer.channels if channel.plane_class == plane_class]
            yield from ((index, c) for i, c in enumerate(of_class) if pass_of(plane_class, i) == number)


def _described(layer: LayerHeader) -> JsonObject:
    return {
        "height": layer.height,
        "width": layer.width,
        "gaussians": layer.gaussians,
        "sh_degree": layer.degree,
        "k": layer.k,
        "depth_limits": list(layer.depth_limits),
        "inverse_depth": layer.inverse_depth,
        "relative_rotation": layer.reference_quats is not None,
        "condition": layer.condition,
        "energy_lost": layer.energy_lost,
    }


def _left_out(index: int, layer: LayerHeader) -> list[JsonObject]:
    entries: list[JsonObject] = []
    d, k = 3 * (layer.degree + 1) ** 2, layer.k
    if layer.degree < layer.source_degree:
        saved = 2 * k * (3 * (layer.source_degree + 1) ** 2 - d)  # of the basis, and its time and memory in a decoder
        entries.append(
            {"layer": index, "what": "sh degree", "kept": layer.degree, "of": layer.source_degree, "bytes_saved": saved}
        )
    if 0 < k < d:
        entries.append(
            {"layer": index, "what": "color components", "kept": k, "of": d, "energy_lost": layer.energy_lost}
        )
    if layer.basis is None:
        entries.append({"layer": index, "what": "basis", "why": "SH degree 0 needs none"})
    entries += [
        {"layer": index, "what": f"plane {channel.name}", "why": "constant", "value": channel.offset}
        for channel in layer.channels
        if not channel.pictures
    ]
    return entries
