"""Write a container: layers' metadata and coded planes in, one file's bytes out. Layout: docs/FORMAT.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ..gaussian.notes import NO_NOTES, Notes
from ..gaussian.planes import BACK_TO_FRONT, CODING_ORDER, PASSES, LayerPlan, PlaneClass
from ..scene.cameras import Camera
from . import layout as L
from .free import FREE, FREE_MINOR
from .notes import MINOR, note_sections


@dataclass(frozen=True)
class CodedChannel:
    """A channel ready for the file: one payload per view, or none for a constant."""

    plane_class: PlaneClass
    target: int
    qp: int
    scale: float
    offset: float
    payloads: tuple[bytes, ...] = ()


@dataclass(frozen=True)
class CodedLayer:
    """A layer ready for the file.

    Attributes:
        height, width: its grid.
        source_degree: SH degree before any was left out.
        plan: how planes map back to attributes.
        channels: coded channels, grouped by class in any order.
        parameter_sets: HEVC parameter sets of all its pictures; empty if every channel is constant.
        cameras: its own, written for layers behind the first.
    """

    height: int
    width: int
    source_degree: int
    plan: LayerPlan
    channels: tuple[CodedChannel, ...]
    parameter_sets: bytes
    cameras: tuple[Camera, ...]


def write_container(
    layers: Sequence[CodedLayer],
    cameras: Sequence[Camera],
    origin: NDArray,
    profile: str,
    qp: float,
    extras: Sequence[tuple[bytes, int, bytes]] = (),
    *,
    layer_count: int | None = None,
    notes: Notes = NO_NOTES,
) -> bytes:
    """The file: metadata first, then planes such that the picture gets better from pass to pass.

    `extras` are the sections of a mode (`extras.py`), which stand between the two; `layer_count` is how many layers
    they hold where `layers` are none. `notes` stand behind the cameras, in every prefix that shows anything.
    """
    scene = L.SCENE_FIXED.pack(len(cameras), layer_count or len(layers), qp, *origin, profile.encode("ascii"))
    sections: list[tuple[bytes, int, bytes]] = [
        (L.SCENE, 0, scene),
        *([(L.CAMERAS, 0, b"".join(_camera(camera) for camera in cameras))] if cameras else []),
        *((kind, 0, data) for kind, data in note_sections(notes).items()),
    ]
    parameter_sets: list[bytes] = []
    for index, layer in enumerate(layers):
        if layer.parameter_sets not in parameter_sets:
            parameter_sets.append(layer.parameter_sets)
        sections.append((L.LAYER, index, _layer(layer, index, parameter_sets.index(layer.parameter_sets))))
    sections += [(L.PARAMETER_SETS, index, sets) for index, sets in enumerate(parameter_sets)]
    return _assemble([*sections, *extras, *_plane_sections(layers)])


def pass_of(plane_class: PlaneClass, number: int) -> int:
    """The pass that the class's record `number` belongs to; never falls from record to record."""
    facts = plane_class.facts
    return facts.passes[0] if number < facts.base else facts.passes[1]


def _plane_sections(layers: Sequence[CodedLayer]) -> list[tuple[bytes, int, bytes]]:
    """Pictures pass by pass; what a later pass adds to a class of a layer is its next part."""
    sections: list[tuple[bytes, int, bytes]] = []
    parts: dict[tuple[PlaneClass, int], int] = {}
    for number in PASSES:
        ordered = list(enumerate(layers))[:: -1 if number == BACK_TO_FRONT else 1]
        for (index, layer), plane_class in product(ordered, CODING_ORDER):
            records = [channel for channel in layer.channels if channel.plane_class == plane_class]
            streams = [p for i, c in enumerate(records) if pass_of(plane_class, i) == number for p in c.payloads]
            if streams:
                part = parts.setdefault((plane_class, index), 0)
                sections.append((L.PLANES[plane_class], index + part * L.PART, b"".join(streams)))
                parts[plane_class, index] += 1
    return sections


def _assemble(sections: Sequence[tuple[bytes, int, bytes]]) -> bytes:
    table = b"".join(
        L.TABLE_ROW.pack(kind, 0 if kind in MINOR else L.REQUIRED, index, len(data), crc32(data))
        for kind, index, data in sections
    )
    minor = max({**MINOR, FREE: FREE_MINOR}.get(kind, L.MINOR) for kind, _, _ in sections)
    head = L.HEADER.pack(L.MAGIC, L.MAJOR, minor, len(sections), 0, 0)[:-4]
    head += crc32(head + table).to_bytes(4, "little")
    return b"".join((head, table, *(data for _, _, data in sections)))


def _intrinsics(K: NDArray) -> tuple[float, ...]:
    return K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1]


def _camera(camera: Camera) -> bytes:
    return L.CAMERA.pack(*_intrinsics(camera.K), *camera.c2w[:3].ravel())


def _layer(layer: CodedLayer, index: int, parameter_set: int) -> bytes:
    plan, reduction = layer.plan, layer.plan.reduction
    flags = (
        L.INVERSE_DEPTH * plan.inverse_depth
        | L.RELATIVE_ROTATION * (plan.reference_quats is not None)
        | L.SCALE_MIX * (plan.scale_mix is not None)
        | L.BASIS * (reduction is not None)
        | L.OWN_INTRINSICS * (index > 0)
    )
    k, lost, condition = (reduction.k, reduction.energy_lost, reduction.condition) if reduction else (0, 0.0, 1.0)
    parts = [
        L.LAYER_FIXED.pack(
            layer.height, layer.width, plan.degree, layer.source_degree, flags, parameter_set, len(layer.channels), k,
            *plan.depth_limits, lost, condition,
        )
    ]  # fmt: skip
    if index > 0:
        parts += [L.INTRINSICS.pack(*_intrinsics(camera.K)) for camera in layer.cameras]
    if plan.reference_quats is not None:
        parts += [L.REFERENCE_QUAT.pack(*quat) for quat in plan.reference_quats]
    if plan.scale_mix is not None:
        parts.append(L.SCALE_MIX_FIELDS.pack(*plan.scale_mix[0].ravel(), *plan.scale_mix[1]))
    if reduction is not None:
        parts.append(np.ascontiguousarray(reduction.inverse, "<f2").tobytes())
    # Records stand in the order of the streams, so that offsets are running sums.
    for channel in sorted(layer.channels, key=lambda c: c.plane_class):
        coding = L.INTRA if channel.payloads else L.CONSTANT
        parts.append(
            L.CHANNEL.pack(channel.plane_class, channel.target, coding, channel.qp, channel.scale, channel.offset)
        )
        parts += [L.STREAM.pack(len(payload), crc32(payload)) for payload in channel.payloads]
    return b"".join(parts)
