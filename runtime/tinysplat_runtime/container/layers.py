"""A layer of coded planes: what its metadata says, read from section LAYR and written to it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ..gaussian.planes import CODING_ORDER, GEOMETRY, MAX_QP, LayerPlan, PlaneClass
from ..gaussian.sh import MAX_SH_DEGREE
from ..scene.cameras import Camera
from . import layout as L
from .body import calibration, camera_in, picked
from .records import ChannelRecord, StreamRef
from .sections import Cursor, Section, require


class PixelGrid:
    """What has a camera per view, all of one size."""

    cameras: tuple[Camera, ...]

    @property
    def height(self) -> int:
        """Rows of the grid."""
        return self.cameras[0].height

    @property
    def width(self) -> int:
        """Columns of the grid."""
        return self.cameras[0].width

    @property
    def gaussians(self) -> int:
        """Gaussians of the layer."""
        return len(self.cameras) * self.height * self.width


@dataclass(frozen=True, kw_only=True)
class LayerMaps(PixelGrid):
    """How the channels of a layer become Gaussians; see `LayerPlan` for what the maps mean.

    Attributes:
        cameras: one per view, with the layer's own grid and intrinsics.
        depth_limits: least and largest z.
        inverse_depth: the depth channel holds −1/z.
        reference_quats: (V, 4) float32 or None.
        scale_mix: ((3, 3), (3,)) float32 or None.
        basis: (d, k) float16, or None where colour planes are degree-0 coefficients.
        channels: the channels that are coded.
    """

    cameras: tuple[Camera, ...]
    depth_limits: tuple[float, float]
    inverse_depth: bool = True
    reference_quats: NDArray | None = None
    scale_mix: tuple[NDArray, NDArray] | None = None
    basis: NDArray | None = None
    channels: tuple[ChannelRecord, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LayerHeader(LayerMaps):
    """A layer's metadata.

    Attributes:
        degree: SH degree stored.
        source_degree: SH degree before any was left out.
        energy_lost: share of weighted colour energy that the basis leaves out.
        condition: condition number of VABR's weighting.
        parameter_set: index of its pictures' parameter sets.
    """

    degree: int
    source_degree: int
    energy_lost: float
    condition: float
    parameter_set: int

    def select(self, views: Sequence[int]) -> LayerHeader:
        """The layer as if there were these views alone."""
        channels = tuple(
            replace(channel, streams=picked(channel.streams, views) if channel.streams else ())
            for channel in self.channels
        )
        quats = None if self.reference_quats is None else self.reference_quats[list(views)]
        return replace(self, cameras=picked(self.cameras, views), channels=channels, reference_quats=quats)

    @property
    def k(self) -> int:
        """Columns of the basis, 0 without one."""
        return 0 if self.basis is None else self.basis.shape[1]


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

    @property
    def records(self) -> tuple[CodedChannel, ...]:
        """The channels in the order of the file's records: by class, as pictures stand in its sections."""
        return tuple(sorted(self.channels, key=lambda channel: channel.plane_class))


def intrinsics(K: NDArray) -> tuple[float, ...]:
    """The numbers of K (3, 3) float64 in the order that files have them in."""
    return K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1]


@dataclass(frozen=True)
class PerView:
    """What a layer has for each view, wherever in the file it stands.

    Attributes:
        intrinsics: fx, fy, cx, cy, skew of each view; empty where they are those of CAMS.
        quats: reference quaternions of each view; empty where rotations are not relative.
        streams: by record, its picture of each view; None where they stand behind the records.
    """

    intrinsics: Sequence[tuple[float, ...]] = ()
    quats: Sequence[tuple[float, ...]] = ()
    streams: Mapping[int, tuple[StreamRef, ...]] | None = None


def layer_section(layer: CodedLayer, index: int, parameter_set: int, *, as_units: bool) -> bytes:
    """The bytes of section LAYR of layer `index`; `as_units` leaves out what stands in sections VIEW."""
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
            layer.height,
            layer.width,
            plan.degree,
            layer.source_degree,
            flags,
            parameter_set,
            len(layer.channels),
            k,
            *plan.depth_limits,
            lost,
            condition,
        )
    ]
    if not as_units:
        parts += [fields for each in zip(*view_fields(layer, index), strict=True) for fields in each]
    if plan.scale_mix is not None:
        parts.append(L.SCALE_MIX_FIELDS.pack(*plan.scale_mix[0].ravel(), *plan.scale_mix[1]))
    if reduction is not None:
        parts.append(np.ascontiguousarray(reduction.inverse, "<f2").tobytes())
    for channel in layer.records:
        coding = L.INTRA if channel.payloads else L.CONSTANT
        parts.append(
            L.CHANNEL.pack(channel.plane_class, channel.target, coding, channel.qp, channel.scale, channel.offset)
        )
        if not as_units:
            parts += [L.STREAM.pack(len(payload), crc32(payload)) for payload in channel.payloads]
    return b"".join(parts)


def view_fields(layer: CodedLayer, index: int) -> list[list[bytes]]:
    """By view, the fields of OWN_INTRINSICS and of RELATIVE_ROTATION, as far as layer `index` has them."""
    quats = layer.plan.reference_quats
    return [
        ([L.INTRINSICS.pack(*intrinsics(camera.K))] if index > 0 else [])
        + ([L.REFERENCE_QUAT.pack(*quats[view])] if quats is not None else [])
        for view, camera in enumerate(layer.cameras)
    ]


def layer_flags(section: Section) -> int:
    """The flags of a section LAYR, of which nothing else is looked at."""
    flags: int = Cursor(section).unpack(L.LAYER_FIXED)[4]
    return flags


def read_layer(section: Section, poses: Sequence[tuple[NDArray, NDArray]], apart: PerView | None = None) -> LayerHeader:
    """Parse and check a section LAYR; `poses` are K (3, 3) and c2w (4, 4) float64, `apart` is of sections VIEW."""
    cursor = Cursor(section)
    height, width, degree, source_degree, flags, sets, n_channels, k, *numbers = cursor.unpack(L.LAYER_FIXED)
    z_min, z_max, lost, condition = numbers
    require(
        1 <= height <= L.MAX_SIDE and 1 <= width <= L.MAX_SIDE,
        section,
        f"grid {width}x{height}, sides are 1 to {L.MAX_SIDE}",
    )
    require(
        degree <= source_degree <= MAX_SH_DEGREE, section, f"SH degree {degree} of {source_degree}, accepted are 0 to 4"
    )
    require(
        0 < z_min <= z_max < math.inf, section, f"depth limits {z_min:g} to {z_max:g}, expected positive and ordered"
    )
    require(math.isfinite(lost) and 0 < condition < math.inf, section, "a number is out of range")
    require(flags < 32, section, f"unknown flags {flags:#x}")
    require(n_channels <= L.MAX_CHANNELS, section, f"{n_channels} channels, at most {L.MAX_CHANNELS}")
    if apart is None:
        own = [cursor.unpack(L.INTRINSICS) for _ in poses] if flags & L.OWN_INTRINSICS else []
        turns = [cursor.unpack(L.REFERENCE_QUAT) for _ in poses] if flags & L.RELATIVE_ROTATION else []
        apart = PerView(own, turns)
    quats = mix = basis = None
    if flags & L.RELATIVE_ROTATION:
        quats = np.array(apart.quats, np.float32).reshape(-1, 4)
        require(
            bool((np.abs(np.linalg.norm(quats.astype(np.float64), axis=1) - 1) < 1e-3).all()),
            section,
            "a reference quaternion is not of length 1",
        )
    if flags & L.SCALE_MIX:
        values = np.array(cursor.unpack(L.SCALE_MIX_FIELDS), np.float32)
        mix = (values[:9].reshape(3, 3), values[9:])
        require(bool(np.isfinite(values).all()), section, "the scale mix is not finite")
    d = 3 * (degree + 1) ** 2
    if flags & L.BASIS:
        require(1 <= k <= d, section, f"k = {k}, accepted are 1 to {d}")
        basis = np.frombuffer(cursor.take(d * k * 2), "<f2").reshape(d, k)
        require(bool(np.isfinite(basis).all()), section, "the basis is not finite")
    else:
        require(degree == 0 and k == 0, section, f"degree {degree} without a basis")
    targets = {**{c: s.stop - s.start for c, s in GEOMETRY.items()}, PlaneClass.COLOR: k or 3}
    channels = _read_channels(cursor, n_channels, targets, len(poses), apart.streams)
    cursor.finish()
    require(all(record < n_channels for record in apart.streams or ()), section, "UNIT lists records beyond its last")
    cameras = [
        camera_in(section, view, calibration(*apart.intrinsics[view]) if apart.intrinsics else K, c2w, width, height)
        for view, (K, c2w) in enumerate(poses)
    ]
    return LayerHeader(
        cameras=tuple(cameras), depth_limits=(z_min, z_max), inverse_depth=bool(flags & L.INVERSE_DEPTH),
        reference_quats=quats, scale_mix=mix, basis=basis, channels=channels, degree=degree,
        source_degree=source_degree, energy_lost=lost, condition=condition, parameter_set=sets,
    )  # fmt: skip


def _read_channels(
    cursor: Cursor,
    count: int,
    targets: Mapping[PlaneClass, int],
    views: int,
    apart: Mapping[int, tuple[StreamRef, ...]] | None,
) -> tuple[ChannelRecord, ...]:
    section = cursor.section
    ends = dict.fromkeys(CODING_ORDER, 0)
    channels: list[ChannelRecord] = []
    for _ in range(count):
        number, target, coding, qp, scale, offset = cursor.unpack(L.CHANNEL)
        require(number in CODING_ORDER, section, f"plane class {number}, known are 0 to {CODING_ORDER[-1]:d}")
        plane_class = PlaneClass(number)
        require(target < targets[plane_class], section, f"{plane_class.label} has no channel {target}")
        require(coding in (L.CONSTANT, L.INTRA), section, f"coding {coding} is unknown")
        require(qp <= MAX_QP, section, f"QP {qp}, accepted are 0 to {MAX_QP}")
        require(
            abs(scale) < 1e30 and abs(offset) < 1e30,
            section,
            f"{plane_class.label}{target}: scale or offset out of range",
        )
        require(not channels or plane_class >= channels[-1].plane_class, section, "channels are out of order")
        is_first = all((plane_class, target) != c.key for c in channels)
        require(is_first or plane_class == PlaneClass.DEPTH, section, f"{plane_class.label}{target} stands twice")
        streams: list[StreamRef] = []
        if apart is not None:
            known = (len(channels) in apart) == (coding == L.INTRA)
            require(known, section, f"UNIT does not list the pictures of record {len(channels)} as they are")
            streams += apart.get(len(channels), ())
        for _ in range(views if coding == L.INTRA and apart is None else 0):
            length, crc = cursor.unpack(L.STREAM)
            streams.append(StreamRef(ends[plane_class], length, crc))
            ends[plane_class] += length
        channels.append(ChannelRecord(plane_class, target, qp, scale, offset, tuple(streams)))
    return tuple(channels)
