"""A file of mode list to Gaussians: docs/FORMAT.md, section 4, "Lists"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...container.list import DETERMINING, ListChannel, ListScene, Tier, order_of, position_streams
from ...errors import FormatError
from ...gaussian.curve import cells_of
from ...gaussian.gaussians import Gaussians
from ...gaussian.planes import PlaneClass
from ...system.blas import product
from ...system.threads import Crew
from ..hevc import CodedPlane
from ..layers import OpenFile
from .attributes import Columns, expanded, from_columns
from .grid import means_of
from .octree import decode_points
from .orders import Order, along_the_curve, channel_values, order_by, reached
from .planes import plane_shape

_ROWS = 1 << 16


@dataclass(frozen=True)
class _Tier:
    """A tier of a file."""

    file: OpenFile
    number: int
    own: Tier

    @property
    def is_present(self) -> bool:
        """Whether it is shown: the first one wherever its positions are, others if only rotations lack."""
        if self.own.lacks(PlaneClass.POSITION):
            return False
        return self.number == 0 or not self.own.lacks(PlaneClass.OPACITY, PlaneClass.SCALE, PlaneClass.COLOR)

    def values(self, channel: ListChannel, order: Order) -> NDArray:
        """A channel's numbers, (count,) float64 by the curve."""
        record = channel.record
        if record.lacks(0):
            return np.full(self.own.count, channel.centre)
        if not record.pictures:
            return channel_values(channel, None, order)
        container = self.file.container
        payload = bytes(container.table.payload(record, 0))
        picture = CodedPlane(container.parameter_sets[self.own.parameter_set], payload)
        return channel_values(channel, picture.decoded(*plane_shape(len(order.rows))), order)


def decode_list(file: OpenFile, scene: ListScene) -> Gaussians:
    """The Gaussians of a file, of whose body the scene is, tier by tier.

    What stands in for pictures that are missing, and which tiers are left out, says FORMAT.md.

    Raises:
        FormatError: damaged; or of the first tier the positions or a picture that the order of others depends on lack.
    """
    tiers = [_Tier(file, number, tier) for number, tier in enumerate(scene.tiers)]
    present = next((tier.number for tier in tiers if not tier.is_present), len(tiers))
    if not present:
        raise FormatError("holds no positions", where="file")
    growth = scene.tiers[present].growth if present < len(tiers) else 0.0
    crew = Crew(file.threads)
    parts = [_decode_tier(scene, tier, growth, crew) for tier in tiers[:present]]
    names = parts[0].keys()
    fields = parts[0] if present == 1 else {name: np.concatenate([part[name] for part in parts]) for name in names}
    return Gaussians.unchecked(**fields, origin=file.container.origin)


def _decode_tier(scene: ListScene, tier: _Tier, growth: float, crew: Crew) -> dict[str, NDArray]:
    """The arrays of one tier's Gaussians."""
    own, grid = tier.own, tier.own.grid
    assert own.positions
    streams = position_streams(own.positions.pictures[0])
    keys = decode_points(streams, grid.levels, grid.leaves, grid.escapes, own.count)
    means = means_of(grid, cells_of(keys))
    found: dict[tuple[PlaneClass, int], NDArray] = {}
    orders, counts = [along_the_curve(own.count)], np.zeros(own.count, np.uint16)
    for place, name in enumerate(DETERMINING):
        channel = own.channel(*name)
        if channel.record.lacks(0):
            lacking = f"holds no intact picture of {channel.record.name}, by which others are sorted"
            raise FormatError(lacking, where="file")
        found[name] = tier.values(channel, orders[place])
        counts += reached(found[name], scene.thresholds[place])
        orders.append(order_by(counts, scene.orders[place]))
    rest = {c.record.key: c for c in own.channels}
    rest = {name: channel for name, channel in rest.items() if name not in found}
    jobs = [(channel, orders[order_of(*name)]) for name, channel in rest.items()]
    found |= dict(zip(rest, crew.map(lambda job: tier.values(*job), jobs), strict=True))
    columns = columns_of(found, scene.size_middle, scene.mean, scene.basis)
    if len(scene.tiers) > 1 and own.lacks(PlaneClass.ROTATION):
        columns = columns.as_spheres()
    return {"means": means, **from_columns(columns, growth)}


def columns_of(
    channels: Mapping[tuple[PlaneClass, int], NDArray], size_middle: float, mean: NDArray, basis: NDArray
) -> Columns:
    """Columns (N, …) of the numbers of all channels, (N,) float32 each, by class and target."""
    colours = [channels[PlaneClass.COLOR, target] for target in range(basis.shape[1])]
    return Columns(
        roots=channels[PlaneClass.OPACITY, 0],
        sizes=expanded(channels[PlaneClass.SCALE, 0], size_middle),
        lengths=channels[PlaneClass.SCALE, 1],
        thins=channels[PlaneClass.SCALE, 2],
        turns=np.stack([channels[PlaneClass.ROTATION, target] for target in range(3)], axis=1),
        sh=_coefficients(len(channels[PlaneClass.OPACITY, 0]), mean, basis, colours),
    )


def _coefficients(count: int, mean: NDArray, basis: NDArray, components: list[NDArray]) -> NDArray:
    """(N, d) float32."""
    out = np.empty((count, len(mean)), np.float32)
    wide = basis.astype(np.float64)
    for start in range(0, count, _ROWS):
        stop = start + _ROWS
        if components:
            part = np.stack([values[start:stop] for values in components], axis=1)
            out[start:stop] = product(part, wide.T) + mean
        else:
            out[start:stop] = mean
    return out
