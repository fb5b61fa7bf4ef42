"""A file of mode free to Gaussians: docs/FORMAT.md, section 4, "Free Gaussians"."""

from __future__ import annotations

from collections.abc import Collection
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
    means = _means(scene.grid, keys)
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
    columns = Columns(
        roots=seen[0],
        sizes=expanded(seen[1], scene.size_middle),
        lengths=seen[2],
        thins=found[PlaneClass.SCALE, 2],
        turns=np.stack([found[PlaneClass.ROTATION, target] for target in range(3)], axis=1),
        sh=_coefficients(scene, [found[PlaneClass.COLOR, target] for target in range(scene.basis.shape[1])]),
    )
    return Gaussians.unchecked(means=means, **from_columns(columns), origin=container.origin)


def _means(grid: PointGrid, keys: NDArray) -> NDArray:
    space = grid.low + cells_of(keys) * grid.cell
    return np.ascontiguousarray(grid.centre + grid.radius * uncontracted(space), np.float32)


def _values(container: Container, channel: FreeChannel, order: Order) -> NDArray:
    record = channel.record
    if not record.streams:
        return channel_values(channel, None, order)
    codes = np.empty(plane_shape(len(order.rows)), np.uint16)
    PlaneDecoder(container.parameter_sets[0], *codes.shape).decode_into(container.pictures.payload(0, record, 0), codes)
    return channel_values(channel, codes, order)


def _coefficients(scene: FreeScene, components: list[NDArray]) -> NDArray:
    """(N, d) float32."""
    out = np.empty((scene.count, len(scene.mean)), np.float32)
    basis = scene.basis.astype(np.float64)
    for start in range(0, scene.count, _ROWS):
        stop = start + _ROWS
        if components:
            part = np.stack([values[start:stop] for values in components], axis=1)
            out[start:stop] = product(part, basis.T) + scene.mean
        else:
            out[start:stop] = scene.mean
    return out
