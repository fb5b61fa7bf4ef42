"""Body `Planes`, of mode gaussians: layers of coded planes, their sections read, written and described."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ..errors import FormatError
from ..gaussian.planes import PlaneClass
from . import layout as L
from .body import Body, Description, Opened, check_totals, picked
from .bounds import check_ranges, decoding_bytes
from .layers import CodedLayer, LayerHeader, layer_section, read_layer
from .records import ChannelRecord, PlanePictures
from .sections import NewSection, Section, require
from .units import UNIT_KINDS, Units, passes

PLANE_KINDS = frozenset(L.PLANES.values())


@dataclass(frozen=True, kw_only=True)
class Planes(Body):
    """Layers of coded planes.

    Attributes:
        layers: metadata, the network's per-pixel layer first.
    """

    mode: ClassVar[str] = "gaussians"
    kinds: ClassVar[frozenset[bytes]] = frozenset({L.CAMERAS, L.LAYER, L.PARAMETER_SETS}) | PLANE_KINDS | UNIT_KINDS
    signs: ClassVar[frozenset[bytes]] = frozenset({L.LAYER})
    is_divisible: ClassVar[bool] = True

    layers: tuple[LayerHeader, ...]

    @classmethod
    def is_told_by(cls, kinds: Collection[bytes]) -> bool:
        """What no other body is told by."""
        return True

    @classmethod
    def read(cls, file: Opened) -> Planes:
        """Parse and check the sections LAYR and those of plane classes, or UNIT and VIEW."""
        file.check_counts()
        units = Units.read(file) if file.has(L.UNITS) else None
        for section in file.sections if units else ():
            require(section.kind not in PLANE_KINDS, section, "does not belong in a file whose views are units")
        layers, gaussians, memory = [], 0, 0
        for index in range(file.layer_count):
            section = file.only(L.LAYER, index)
            layer = read_layer(section, file.poses, units.layer(index) if units else None)
            gaussians += layer.gaussians
            memory += decoding_bytes(layer)
            check_totals(gaussians, memory, file.limits, section.label)
            check_ranges(layer, file.origin, section.label)
            if any(channel.streams for channel in layer.channels):
                file.require_parameter_set(layer.parameter_set, section.label)
            layers.append(layer)
        channels = [layer.channels for layer in layers]
        pictures = units.pictures(channels) if units else read_pictures(file.sections, channels)
        cameras = file.cameras(layers[0].height, layers[0].width)
        return cls(cameras=cameras, pictures=pictures, layers=tuple(layers))

    def select(self, views: Sequence[int]) -> Planes:
        """The body as if there were these views alone."""
        layers = tuple(layer.select(views) for layer in self.layers)
        channels, numbers = tuple(layer.channels for layer in layers), tuple(map(self.pictures.number, views))
        pictures = replace(self.pictures, channels=channels, views=numbers)
        return replace(self, cameras=picked(self.cameras, views), pictures=pictures, layers=layers)

    def describe(self) -> Description:
        """Gaussians, layers, and what was left out of them."""
        return Description(
            gaussians=sum(layer.gaussians for layer in self.layers),
            sh_degree=self.layers[0].degree,
            k=self.layers[0].k,
            layers=tuple(_described(layer) for layer in self.layers),
            left_out=tuple(entry for index, layer in enumerate(self.layers) for entry in _left_out(index, layer)),
        )


def read_pictures(sections: Sequence[Section], channels: Sequence[Sequence[ChannelRecord]]) -> PlanePictures:
    """The pictures of a file whose layers have such channels.

    Raises:
        FormatError: sections are missing, out of order, of another length than their pictures, or without any.
    """
    found = tuple(section for section in sections if section.kind in PLANE_KINDS)
    coded = {(c.plane_class, index): c for index, records in enumerate(channels) for c in records if c.streams}
    for section in found:
        if not any((L.PLANES[c], index) == (section.kind, section.index % L.PART) for c, index in coded):
            raise FormatError("holds pictures of no channel", where=section.label)
    # Records of a class stand in the order of their pictures, so that the last one kept ends where the section does.
    data = {key: _joined(found, *key, last) for key, last in coded.items()}
    return PlanePictures(tuple(map(tuple, channels)), data, found)


def _joined(sections: Sequence[Section], plane_class: PlaneClass, index: int, last: ChannelRecord) -> memoryview:
    """The pictures of a class, whose sections have the indices layer, layer + PART, layer + 2·PART, … in this order.

    Pictures have a CRC each, checked when they are decoded.
    """
    kind = L.PLANES[plane_class]
    parts = [s for s in sections if s.kind == kind and s.index % L.PART == index]
    label = f"section {kind.decode('ascii')}[{index}]"
    if not parts:
        raise FormatError("missing", where=label)
    if [s.index // L.PART for s in parts] != list(range(len(parts))):
        raise FormatError("its parts are not each there once and in order", where=label)
    stated = sum(s.length for s in parts)
    end = last.streams[-1].offset + last.streams[-1].length
    if end != stated:
        raise FormatError(f"{stated} bytes, its pictures need {end}", where=label)
    # A prefix ends in at most one section and holds nothing of those behind it, so that what is joined has no gap.
    return parts[0].data if len(parts) == 1 else memoryview(b"".join(s.data for s in parts))


def layer_sections(layers: Sequence[CodedLayer], *, as_units: bool) -> list[NewSection]:
    """The metadata of layers, and their parameter sets; `as_units` for files whose views are."""
    parameter_sets: list[bytes] = []
    sections = []
    for index, layer in enumerate(layers):
        if layer.parameter_sets not in parameter_sets:
            parameter_sets.append(layer.parameter_sets)
        data = layer_section(layer, index, parameter_sets.index(layer.parameter_sets), as_units=as_units)
        sections.append(NewSection(L.LAYER, index, data))
    return sections + [NewSection(L.PARAMETER_SETS, index, sets) for index, sets in enumerate(parameter_sets)]


def plane_sections(layers: Sequence[CodedLayer]) -> list[NewSection]:
    """Pictures pass by pass; what a later pass adds to a class of a layer is its next part."""
    sections: list[NewSection] = []
    parts: dict[tuple[PlaneClass, int], int] = {}
    for index, plane_class, records in passes(layers):
        part = parts.setdefault((plane_class, index), 0)
        streams = [payload for number in records for payload in layers[index].records[number].payloads]
        sections.append(NewSection(L.PLANES[plane_class], index + part * L.PART, b"".join(streams)))
        parts[plane_class, index] += 1
    return sections


def _described(layer: LayerHeader) -> dict[str, Any]:
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


def _left_out(index: int, layer: LayerHeader) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = []
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
        if not channel.streams
    ]
    return entries
