"""A layer of coded planes: what its metadata says, read from section LAYR and written to it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..gaussian.planes import GEOMETRY, LayerPlan, PlaneClass
from ..gaussian.sh import MAX_SH_DEGREE
from ..scene.cameras import Camera
from . import layout as L
from .body import Opened
from .cameras import has_own_intrinsics, packed_intrinsics
from .records import ChannelRecord
from .sections import Cursor, NewSection, packed_columns, read_columns, require

UNIT_TOLERANCE = 1e-3
"""Of the length of a reference quaternion."""


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

    @property
    def k(self) -> int:
        """Columns of the basis, 0 without one."""
        return 0 if self.basis is None else self.basis.shape[1]


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
    channels: tuple[ChannelRecord, ...]
    parameter_sets: bytes
    cameras: tuple[Camera, ...]


def layer_section(layer: CodedLayer, index: int, parameter_set: int, cameras: Sequence[Camera]) -> NewSection:
    """The section LAYR of layer `index` of a file with such cameras."""
    plan, reduction = layer.plan, layer.plan.reduction
    has_own = index > 0 and has_own_intrinsics(cameras, layer.cameras)
    flags = (
        L.INVERSE_DEPTH * plan.inverse_depth
        | L.OWN_INTRINSICS * has_own
        | L.RELATIVE_ROTATION * (plan.reference_quats is not None)
        | L.SCALE_MIX * (plan.scale_mix is not None)
        | L.BASIS * (reduction is not None)
    )
    k, lost, condition = (reduction.k, reduction.energy_lost, reduction.condition) if reduction else (0, 0.0, 1.0)
    sizes = layer.height, layer.width, plan.degree, layer.source_degree
    parts = [L.LAYER_FIXED.pack(*sizes, flags, parameter_set, k, *plan.depth_limits, lost, condition)]
    if has_own:
        parts.append(packed_intrinsics(layer.cameras))
    if plan.reference_quats is not None:
        parts.append(packed_columns(plan.reference_quats.astype(np.float64)))
    if plan.scale_mix is not None:
        parts.append(L.SCALE_MIX_FIELDS.pack(*plan.scale_mix[0].ravel(), *plan.scale_mix[1]))
    if reduction is not None:
        parts.append(np.ascontiguousarray(reduction.inverse, "<f2").tobytes())
    return NewSection(L.LAYER, index, b"".join(parts))


def read_layer(file: Opened, index: int) -> LayerHeader:
    """Parse and check layer `index` of a file: its section LAYR, and its rows of the table of pictures."""
    section = file.only(L.LAYER, index)
    cursor = Cursor(section)
    height, width, degree, source_degree, flags, sets, k, z_min, z_max, lost, condition = cursor.unpack(L.LAYER_FIXED)
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
    if not index:
        file.check_sizes(height, width, section.label)
    cameras = file.layer_cameras(cursor, height, width, has_own=bool(flags & L.OWN_INTRINSICS))
    quats = mix = basis = None
    if flags & L.RELATIVE_ROTATION:
        rows = read_columns(cursor, file.views, 4)[list(file.table.views)]
        with np.errstate(over="ignore"):
            quats, lengths = rows.astype(np.float32), np.linalg.norm(rows, axis=1)
        is_unit = np.abs(lengths - 1) < UNIT_TOLERANCE
        require(bool(is_unit.all()), section, "a reference quaternion is not of length 1")
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
    cursor.finish()
    channels = file.table.layer(index)
    targets = {**{c: s.stop - s.start for c, s in GEOMETRY.items()}, PlaneClass.COLOR: k or 3}
    for number, channel in enumerate(channels):
        known = channel.target < targets[channel.plane_class]
        require(known, section, f"{channel.plane_class.label} has no channel {channel.target}")
        is_first = all(channel.key != earlier.key for earlier in channels[:number])
        require(is_first or channel.plane_class == PlaneClass.DEPTH, section, f"{channel.name} stands twice")
    file.require_parameter_set(sets, channels, section.label)
    return LayerHeader(
        cameras=cameras, depth_limits=(z_min, z_max), inverse_depth=bool(flags & L.INVERSE_DEPTH),
        reference_quats=quats, scale_mix=mix, basis=basis, channels=channels, degree=degree,
        source_degree=source_degree, energy_lost=lost, condition=condition, parameter_set=sets,
    )  # fmt: skip
