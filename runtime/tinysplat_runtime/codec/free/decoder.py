"""A file of mode free to Gaussians: docs/FORMAT.md, section 4, "Free Gaussians"."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ...container.body import Container
from ...container.free import DETERMINING, order_of
from ...container.records import FreeChannel, FreeScene, PointGrid
from ...errors import FormatError
from ...gaussian.gaussians import Gaussians
from ...gaussian.planes import PlaneClass
from ...system.blas import product
from ..hevc import PlaneDecoder
from ..missing import PlaneRef
from .attributes import Columns, expanded, from_columns, uncontracted
from .octree import cells_of, decode_points
from .orders import Order, along_the_curve, channel_values, order_by
from .planes import plane_shape

_ROWS = 1 << 16


def decode_free(container: Container, scene: FreeScene, missing: Collection[PlaneRef], threads: int) -> Gaussians:
    """The Gaussians of a file.

    Args:
        container: of mode free.
        scene: what its body says.
        missing: pictures that are not at hand: every Gaussian gets what their channels are centred on.
        threads: pictures decoded at a time.

    Raises:
        FormatError: damaged; or a picture is missing that the order of others depends on.
    """
    keys = decode_points(scene.grid.streams, scene.grid.levels, scene.grid.leaves, scene.grid.escapes, scene.count)
    means = means_of(scene.grid, cells_of(keys))
    absent = {scene.channels[ref.channel].record.name for ref in missing}
    seen: list[NDArray] = []
    orders = [along_the_curve(scene.count)]
    for number, name in enumerate(DETERMINING):
        channel = scene.channel(*name)
        if channel.record.name in absent:
            lacking = f"holds no intact picture of {channel.record.name}, by which others are sorted"
            raise FormatError(lacking, where="file")
        seen.append(_values(container, channel, orders[number]))
        orders.append(order_by(seen, scene.thresholds, scene.orders[number]))
    rest = [c for c in scene.channels if (c.record.plane_class, c.record.target) not in DETERMINING]

    def decode(channel: FreeChannel) -> NDArray:
        if channel.record.name in absent:
            return np.full(scene.count, channel.centre)
        order = orders[order_of(channel.record.plane_class, channel.record.target)]
        return _values(container, channel, order)

    with ThreadPoolExecutor(max_workers=threads) as pool:
        found = {(c.record.plane_class, c.record.target): v for c, v in zip(rest, pool.map(decode, rest), strict=True)}
    found |= dict(zip(DETERMINING, seen, strict=True))
    columns = columns_of(found, scene.size_middle, scene.mean, scene.basis)
    return Gaussians.unchecked(means=means, **from_columns(columns), origin=container.origin)


def columns_of(
    channels: Mapping[tuple[PlaneClass, int], NDArray], size_middle: float, mean: NDArray, basis: NDArray
) -> Columns:
    """Columns (N) of the numbers of all channels, by class and target."""
    colours = [channels[PlaneClass.COLOR, target] for target in range(basis.shape[1])]
    return Columns(
        roots=channels[PlaneClass.OPACITY, 0],
        sizes=expanded(channels[PlaneClass.SCALE, 0], size_middle),
        lengths=channels[PlaneClass.SCALE, 1],
        thins=channels[PlaneClass.SCALE, 2],
        turns=np.stack([channels[PlaneClass.ROTATION, target] for target in range(3)], axis=1),
        sh=_coefficients(len(channels[PlaneClass.OPACITY, 0]), mean, basis, colours),
    )


def means_of(grid: PointGrid, cells: NDArray) -> NDArray:
    """(N, 3) float32 positions of (N, 3) cells."""
    space = grid.low + cells * grid.cell
    return np.ascontiguousarray(grid.centre + grid.radius * uncontracted(space), np.float32)


def _values(container: Container, channel: FreeChannel, order: Order) -> NDArray:
    record = channel.record
    if not record.streams:
        return channel_values(channel, None, order)
    codes = np.empty(plane_shape(len(order.rows)), np.uint16)
    PlaneDecoder(container.parameter_sets[0], *codes.shape).decode_into(container.pictures.payload(0, record, 0), codes)
    return channel_values(channel, codes, order)


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
