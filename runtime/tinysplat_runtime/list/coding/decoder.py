"""A file of mode list to Gaussians: docs/FORMAT.md, section 4, "Lists"."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...codec.hevc import CodedPlane
from ...codec.layers import OpenFile
from ...container.list import DETERMINING, ListChannel, ListScene, Tier, order_of, position_streams
from ...errors import FormatError
from ...gaussian.curve import cells_of
from ...gaussian.gaussians import Gaussians
from ...gaussian.planes import PlaneClass
from ...system.blas import product
from ...system.threads import Crew
from .attributes import ROWS, Columns, expanded, from_columns
from .grid import means_of
from .octree import decode_points
from .orders import Numbers, Order, along_the_curve, order_by, reached
from .planes import plane_shape


@dataclass(frozen=True)
class _Tier:
    """A tier of a file; `another` is called when one of its pictures is decoded."""

    file: OpenFile
    number: int
    own: Tier
    another: Callable[[], object] = object

    @property
    def is_present(self) -> bool:
        """Whether it is shown: the first one wherever its positions are, others if only rotations lack."""
        if self.own.lacks(PlaneClass.POSITION):
            return False
        return self.number == 0 or not self.own.lacks(PlaneClass.OPACITY, PlaneClass.SCALE, PlaneClass.COLOR)

    def values(self, channel: ListChannel, order: Order) -> Numbers:
        """A channel's numbers."""
        found = self._values(channel, order)
        self.another()
        return found

    def _values(self, channel: ListChannel, order: Order) -> Numbers:
        record = channel.record
        if record.lacks(0):
            return Numbers.alike(self.own.count, channel.centre)
        if not record.pictures:
            return Numbers.of(channel, None, order)
        container = self.file.container
        payload = bytes(container.table.payload(record, 0))
        picture = CodedPlane(container.parameter_sets[self.own.parameter_set], payload)
        return Numbers.of(channel, picture.decoded(*plane_shape(len(order.rows))), order)


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
    fields, parts = arrays_by_tier([tier.own.count for tier in tiers[:present]], len(scene.mean))
    with file.told.counting("decoding pictures", sum(len(tier.own.channels) for tier in tiers[:present])) as another:
        for tier, part in zip(tiers, parts, strict=False):
            _decode_tier(scene, replace(tier, another=another), growth, crew, part)
    return Gaussians.unchecked(**fields, origin=file.container.origin)


def _decode_tier(scene: ListScene, tier: _Tier, growth: float, crew: Crew, into: Mapping[str, NDArray]) -> None:
    """Fill the arrays of one tier's Gaussians."""
    own, grid = tier.own, tier.own.grid
    assert own.positions
    streams = position_streams(own.positions.pictures[0])
    keys = decode_points(streams, grid.levels, grid.leaves, grid.escapes, own.count)
    into["means"][:] = means_of(grid, cells_of(keys))
    del keys
    found: dict[tuple[PlaneClass, int], Numbers] = {}
    orders, counts = [along_the_curve(own.count)], np.zeros(own.count, np.uint16)
    for place, name in enumerate(DETERMINING):
        channel = own.channel(*name)
        if channel.record.lacks(0):
            lacking = f"holds no intact picture of {channel.record.name}, by which others are sorted"
            raise FormatError(lacking, where="file")
        found[name] = tier.values(channel, orders[place])
        counts += reached(found[name][:], scene.thresholds[place])
        orders.append(order_by(counts, scene.orders[place]))
    rest = {c.record.key: c for c in own.channels}
    rest = {name: channel for name, channel in rest.items() if name not in found}
    jobs = [(channel, orders[order_of(*name)]) for name, channel in rest.items()]
    found |= dict(zip(rest, crew.map(lambda job: tier.values(*job), jobs), strict=True))
    is_unturned = len(scene.tiers) > 1 and own.lacks(PlaneClass.ROTATION)
    palette = scene.size_middle, scene.mean, scene.basis
    fill(into, found, *palette, growth=growth, as_spheres=is_unturned)


def arrays_by_tier(counts: Sequence[int], coefficients: int) -> tuple[dict[str, NDArray], list[dict[str, NDArray]]]:
    """Arrays of all Gaussians, and the parts of them that are each tier's, of so many; SH of so many coefficients."""
    shapes = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "sh": (coefficients // 3, 3)}
    arrays = {name: np.empty((sum(counts), *shape), np.float32) for name, shape in shapes.items()}
    ends = np.cumsum(counts).tolist()
    parts = [slice(end - count, end) for count, end in zip(counts, ends, strict=True)]
    return arrays, [{name: array[part] for name, array in arrays.items()} for part in parts]


def fill(
    into: Mapping[str, NDArray],
    channels: Mapping[tuple[PlaneClass, int], Numbers],
    middle: float,
    mean: NDArray,
    basis: NDArray,
    *,
    growth: float = 0.0,
    as_spheres: bool = False,
) -> None:
    """Fill in all but the means from the numbers of all channels.

    Args:
        into: quats (N, 4), scales (N, 3), opacities (N,), sh (N, B, 3) float32.
        channels: (N,) each, by class and target.
        middle, mean, basis: as `ListScene` has them.
        growth: as `from_columns` has it.
        as_spheres: as nobody knows how they are turned.
    """
    wide = basis.astype(np.float64).T
    for start in range(0, len(into["sh"]), ROWS):
        part = slice(start, start + ROWS)
        columns = Columns(
            roots=channels[PlaneClass.OPACITY, 0][part],
            sizes=expanded(channels[PlaneClass.SCALE, 0][part], middle),
            lengths=channels[PlaneClass.SCALE, 1][part],
            thins=channels[PlaneClass.SCALE, 2][part],
            turns=np.stack([channels[PlaneClass.ROTATION, target][part] for target in range(3)], axis=1),
        )
        arrays = from_columns(columns.as_spheres() if as_spheres else columns, growth)
        colours = [channels[PlaneClass.COLOR, target][part] for target in range(len(wide))]
        sh = product(np.stack(colours, axis=1), wide) + mean if colours else np.tile(mean, (len(columns.roots), 1))
        arrays["sh"] = sh.reshape(-1, *into["sh"].shape[1:])
        for name, values in arrays.items():
            into[name][part] = values
