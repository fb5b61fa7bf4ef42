"""Body `List`, of mode list: Gaussians that belong to no pixels. Layout: docs/FORMAT.md, `LIST` and `TIER`.

Reading checks every number and length against limits before anything is decoded, and shows by the numbers' ranges that
nothing can come to more than float32 holds.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from ..gaussian.planes import MAX_CODE, MAX_DECODED, PlaneClass
from ..gaussian.sh import MAX_SH_DEGREE
from ..scene.cameras import Camera
from . import layout as L
from .body import Body, Description, Opened, check_totals
from .cameras import with_steps
from .records import ChannelRecord, Picture
from .sections import Cursor, NewSection, require
from .table import Row

LIST = b"LIST"
TIER = b"TIER"

LIST_FIXED = struct.Struct("<BBHdddddddf")
"""SH degree, reserved (0), k, centre (3), radius, low (3), and size_middle"""

TIER_FIXED = struct.Struct("<IBBHIIdf")
"""count, levels, parameter-set index, reserved (0), leaves, escapes, cell, growth."""

MAX_GROWTH = 2.0

MAX_LEVELS = 21
POINT_STREAMS = 6
MAX_THRESHOLDS = 255
MAX_CLASSES = 32

MAX_EXPONENT = 69.0
"""Largest logarithm of a scale, and of a contracted coordinate: e⁶⁹ is 9e29."""

MAX_PER_BYTE = 256
"""Gaussians that a byte of a file may stand for, so that memory is paid for. Coded ones take a byte and more at any
useful quality; only equal ones in one place could take next to none."""

COUNT = struct.Struct("<H")
STREAMS_FIXED = struct.Struct(f"<{POINT_STREAMS}I")
"""Bytes of each stream of the positions, which follow."""

TARGETS = {PlaneClass.OPACITY: 1, PlaneClass.SCALE: 3, PlaneClass.ROTATION: 3}
"""Channels of each class but colour: √opacity; size, length, thickness; a rotation's vector part."""

DETERMINING = ((PlaneClass.OPACITY, 0), (PlaneClass.SCALE, 0), (PlaneClass.SCALE, 1))
"""Channels that say how much a Gaussian weighs: opacity, size, length."""

CLASSES = (PlaneClass.COLOR, *TARGETS, PlaneClass.POSITION)

BYTE_ORDER = (PlaneClass.POSITION, PlaneClass.OPACITY, PlaneClass.SCALE, PlaneClass.COLOR, PlaneClass.ROTATION)
"""Classes as our writer puts them, such that a prefix shows as much as it can."""


@dataclass(frozen=True)
class PointGrid:
    """Where positions can lie.

    Attributes:
        centre, radius: coordinates within `radius` of the centre are taken as they are, those beyond as logarithms.
        cell: side of a cell of the contracted space, whose unit is the radius.
        low: (3,) contracted coordinates of cell 0's middle.
        levels: cells of each level of the octree from its root.
        leaves, escapes: see `list.coding.octree`.
        streams: the octree's bytes, where they are to be written.
    """

    centre: NDArray
    radius: float
    cell: float
    low: NDArray
    levels: tuple[int, ...]
    leaves: int
    escapes: int
    streams: tuple[bytes | memoryview, ...]


@dataclass(frozen=True)
class WeightClasses:
    """An order of Gaussians by what they weigh, in classes.

    Attributes:
        first: what is subtracted from half the count of thresholds reached.
        gains: by class, what a channel's decoded number is multiplied by.
    """

    first: int
    gains: tuple[float, ...]


@dataclass(frozen=True)
class ListChannel:
    """A channel: `record` as in layers with one picture, and what is added behind the gain."""

    record: ChannelRecord
    centre: float


@dataclass(frozen=True)
class Tier:
    """Some of the Gaussians of a list.

    Attributes:
        count: how many.
        grid: where they lie.
        channels: all that there are, by class and target.
        positions: the row with their positions, in a file that is read.
        parameter_set: index of its pictures' parameter sets.
        growth: what is added to logarithms of scales in front of it where the tier is absent.
    """

    count: int
    grid: PointGrid
    channels: tuple[ListChannel, ...]
    positions: ChannelRecord | None = None
    parameter_set: int = 0
    growth: float = 0.0

    def channel(self, plane_class: PlaneClass, target: int) -> ListChannel:
        """One of the channels, each of which there is."""
        return next(c for c in self.channels if c.record.key == (plane_class, target))

    def lacks(self, *classes: PlaneClass) -> bool:
        """Whether a picture of one of the classes is not at hand."""
        records = [*(c.record for c in self.channels), *([self.positions] if self.positions else [])]
        return any(record.lacks(0) for record in records if record.plane_class in classes)


@dataclass(frozen=True)
class ListScene:
    """The metadata of a list.

    Attributes:
        size_middle: logarithm of the size whose steps are those of the logarithm.
        thresholds: of each determinant, rising.
        orders: by one, two and all three determinants.
        mean: (d,) float32, d = 3(degree + 1)².
        basis: (d, k) float16.
        tiers: from those that pictures need most, at least one; their grids have centre, radius and low in common.
    """

    degree: int
    size_middle: float
    thresholds: tuple[NDArray, ...]
    orders: tuple[WeightClasses, ...]
    mean: NDArray
    basis: NDArray
    tiers: tuple[Tier, ...]

    @property
    def count(self) -> int:
        """Gaussians of all tiers."""
        return sum(tier.count for tier in self.tiers)


@dataclass(frozen=True, kw_only=True)
class List(Body):
    """One scene without cameras of pixels, in tiers.

    Attributes:
        scene: metadata.
        viewpoints: cameras of the photos that the Gaussians were made from, as far as they are known, with their steps.
    """

    mode: ClassVar[str] = "list"
    sign: ClassVar[bytes] = LIST
    kinds: ClassVar[frozenset[bytes]] = frozenset({LIST, TIER, L.CAMERAS, L.STEPS, L.PARAMETER_SETS})

    scene: ListScene
    viewpoints: tuple[Camera, ...] = ()

    @classmethod
    def read(cls, file: Opened) -> List:
        """Parse and check the sections LIST, TIER, CAMS and STEP."""
        most = file.limits.max_layers
        require(1 <= file.layer_count <= most, file.scene, f"{file.layer_count} tiers, accepted are 1 to {most}")
        require(file.views <= L.MAX_VIEWS, file.scene, f"{file.views} cameras, accepted are 0 to {L.MAX_VIEWS}")
        require(file.table.count == 1, file.scene, f"rows of a list with {file.table.count} pictures")
        file.check_rows(CLASSES)
        viewpoints = file.cameras_of(range(file.views))
        moved = [section for section in file.sections if section.kind == L.STEPS]
        return cls(scene=read_list(file), viewpoints=with_steps(viewpoints, moved[0]) if moved else viewpoints)

    def describe(self) -> Description:
        """Gaussians, tiers, and cameras of photos."""
        scene = self.scene
        tiers = tuple(tier.count for tier in scene.tiers)
        found = scene.count, scene.degree, scene.basis.shape[1]
        return Description(*found, tiers=tiers, viewpoints=self.viewpoints)

    @staticmethod
    def step(layer: int, record: ChannelRecord, number: int) -> Hashable:
        """Shapes, colours and rotations; a tier behind the first shows with its colours at once."""
        if record.plane_class == PlaneClass.ROTATION:
            return 2
        return int(layer == 0 and record.plane_class == PlaneClass.COLOR)

    def picture_name(self, layer: int, channel: ChannelRecord, view: int) -> str:
        """There is one of each in a tier: `color2`, `tier 1 color2`."""
        return f"tier {layer} " * (layer > 0) + channel.name


def order_of(plane_class: PlaneClass, target: int) -> int:
    """How many determinants a channel's order follows: 0 is the curve alone."""
    if plane_class == PlaneClass.ROTATION:
        return 3
    if plane_class == PlaneClass.OPACITY:
        return 0
    return 1 if (plane_class, target) == (PlaneClass.SCALE, 0) else 2


def list_sections(scene: ListScene, parameter_sets: Sequence[bytes]) -> list[NewSection]:
    """The metadata of a scene, and by tier its parameter sets, empty where it has no pictures."""
    grid, k = scene.tiers[0].grid, scene.basis.shape[1]
    parts = [LIST_FIXED.pack(scene.degree, 0, k, *grid.centre, grid.radius, *grid.low, scene.size_middle)]
    parts += [COUNT.pack(len(values)) + values.astype("<f4").tobytes() for values in scene.thresholds]
    for order in scene.orders:
        parts.append(COUNT.pack(order.first) + COUNT.pack(len(order.gains)) + np.array(order.gains, "<f4").tobytes())
    parts += [scene.mean.astype("<f4").tobytes(), np.ascontiguousarray(scene.basis, "<f2").tobytes()]
    sections = [NewSection(LIST, 0, b"".join(parts))]
    for number, tier in enumerate(scene.tiers):
        grid = tier.grid
        fixed = tier.count, len(grid.levels), number, 0, grid.leaves, grid.escapes, grid.cell, tier.growth
        numbers = np.array(grid.levels, "<u4").tobytes() + np.array([c.centre for c in tier.channels], "<f4").tobytes()
        sections.append(NewSection(TIER, number, TIER_FIXED.pack(*fixed) + numbers))
    return sections + [NewSection(L.PARAMETER_SETS, n, sets) for n, sets in enumerate(parameter_sets) if sets]


def list_rows(scene: ListScene, payloads: Sequence[Mapping[tuple[PlaneClass, int], bytes]]) -> Iterator[Row]:
    """The rows of a scene's tiers; `payloads` are by tier the pictures of the channels that are no numbers."""
    for number, (tier, pictures) in enumerate(zip(scene.tiers, payloads, strict=True)):
        streams = tier.grid.streams
        points = STREAMS_FIXED.pack(*map(len, streams)) + b"".join(map(bytes, streams))
        channels = [
            replace(record, pictures=Picture.each_of([pictures[record.key]] if record.key in pictures else []))
            for record in (channel.record for channel in tier.channels)
        ]
        channels.append(ChannelRecord(PlaneClass.POSITION, 0, 0, 0.0, 0.0, Picture.each_of([points])))
        yield from ((number, c) for c in sorted(channels, key=lambda c: (BYTE_ORDER.index(c.plane_class), c.target)))


def position_streams(picture: Picture) -> list[memoryview]:
    """The streams of a tier's positions; FormatError where they are cut off, altered or of other lengths."""
    data = picture.checked("positions")
    lengths = STREAMS_FIXED.unpack(data[: STREAMS_FIXED.size]) if len(data) >= STREAMS_FIXED.size else ()
    ends = [STREAMS_FIXED.size + sum(lengths[:n]) for n in range(len(lengths) + 1)]
    if ends[-1] != len(data):
        raise FormatError(f"{len(data)} bytes, their streams have {ends[-1]}", where="positions")
    return [data[start:end] for start, end in pairwise(ends)]


def read_list(file: Opened) -> ListScene:
    """Parse and check the sections LIST and TIER; FormatError where they are damaged, or beyond the limits."""
    cursor = Cursor(file.only(LIST))
    degree, _, k, *centre, radius, low_x, low_y, low_z, middle = cursor.unpack(LIST_FIXED)
    d = 3 * (degree + 1) ** 2
    cursor.require(degree <= MAX_SH_DEGREE, f"SH degree {degree}, accepted are 0 to {MAX_SH_DEGREE}")
    cursor.require(k <= d, f"k = {k}, accepted are 0 to {d}")
    thresholds = tuple(_read_floats(cursor, MAX_THRESHOLDS, "thresholds") for _ in DETERMINING)
    for values in thresholds:
        cursor.require(bool((np.diff(values) > 0).all()), "thresholds do not rise")
    orders = tuple(_read_order(cursor) for _ in DETERMINING)
    mean = np.frombuffer(cursor.take(4 * d), "<f4")
    basis = np.frombuffer(cursor.take(2 * d * k), "<f2").reshape(d, k)
    cursor.finish()
    space = PointGrid(np.array(centre), radius, 0.0, np.array([low_x, low_y, low_z]), (), 0, 0, ())
    cursors = [Cursor(file.only(TIER, number)) for number in range(file.layer_count)]
    tiers = tuple(_read_tier(file, number, tier, space, k) for number, tier in enumerate(cursors))
    scene = ListScene(degree, middle, thresholds, orders, mean, basis, tiers)
    paid = MAX_PER_BYTE * sum(len(section.data) for section in file.sections)
    cursor.require(scene.count <= paid, f"{scene.count} Gaussians, the file's bytes stand for {paid} at most")
    check_totals(scene.count, decoding_bytes(scene.count, degree, k), file.limits, cursor.section.label)
    fault = range_fault(scene)
    cursor.require(fault is None, fault[1] if fault else "")
    return scene


def _read_tier(file: Opened, number: int, cursor: Cursor, space: PointGrid, k: int) -> Tier:
    count, n_levels, parameter_set, _, leaves, escapes, cell, growth = cursor.unpack(TIER_FIXED)
    cursor.require(count > 0, "0 Gaussians, accepted are 1 and more")
    cursor.require(0 <= growth <= MAX_GROWTH, f"growth {growth:g}, accepted are 0 to {MAX_GROWTH:g}")
    cursor.require(1 <= n_levels <= MAX_LEVELS, f"{n_levels} levels, accepted are 1 to {MAX_LEVELS}")
    levels = np.frombuffer(cursor.take(4 * n_levels), "<u4").astype(np.int64)
    chain = np.array([*levels, leaves])
    fits = levels[0] == 1 and bool((np.diff(chain) >= 0).all()) and bool((chain[1:] <= 8 * chain[:-1]).all())
    cursor.require(fits, "the octree's levels do not grow as an octree's do")
    sizes = f"{leaves} leaves and {escapes} escapes for {count} Gaussians"
    cursor.require(leaves <= count and escapes <= leaves, sizes)
    grid = replace(space, cell=cell, levels=tuple(levels.tolist()), leaves=leaves, escapes=escapes)
    centres = np.frombuffer(cursor.take(4 * (7 + k)), "<f4")
    cursor.require(bool((np.abs(centres) < MAX_DECODED).all()), "a centre is out of range")
    cursor.finish()
    records = file.table.layer(number)
    expected = [(PlaneClass.COLOR, target) for target in range(k)]
    expected += [(c, target) for c, targets in TARGETS.items() for target in range(targets)]
    found = sorted(record.key for record in records)
    if found != [*expected, (PlaneClass.POSITION, 0)] or not records[-1].pictures:
        names = f"{len(records)} channels of tier {number}, expected {len(expected)} and positions, each once"
        raise FormatError(names, where="section PICT[0]")
    by_key = {record.key: record for record in records}
    channels = tuple(ListChannel(by_key[key], float(centre)) for key, centre in zip(expected, centres, strict=True))
    file.require_parameter_set(parameter_set, records[:-1], cursor.section.label)
    return Tier(count, grid, channels, by_key[PlaneClass.POSITION, 0], parameter_set, growth)


def decoding_bytes(count: int, degree: int, k: int) -> int:
    """Memory that decoding takes: the Gaussians, codes and numbers that they come from, and cells of the octree."""
    d = 3 * (degree + 1) ** 2
    return count * (4 * (11 + d) + 2 * (7 + k) + 8 * (16 + k) + 64)


def _read_floats(cursor: Cursor, most: int, name: str) -> NDArray:
    (count,) = cursor.unpack(COUNT)
    cursor.require(count <= most, f"{count} {name}, at most {most}")
    values = np.frombuffer(cursor.take(4 * count), "<f4")
    cursor.require(bool((np.abs(values) < MAX_DECODED).all()), f"{name} out of range")
    return values


def _read_order(cursor: Cursor) -> WeightClasses:
    (first,) = cursor.unpack(COUNT)
    gains = _read_floats(cursor, MAX_CLASSES, "gains")
    cursor.require(len(gains) > 0, "an order without gains")
    return WeightClasses(first, tuple(gains.tolist()))


def range_fault(scene: ListScene) -> tuple[str, str] | None:
    """Which attribute could decode, by some codes, to what float32 does not hold, and to what; None if none could."""
    for tier in scene.tiers:
        if found := _grid_fault(tier.grid, len(tier.grid.levels)):
            return "means", found
    if not abs(scene.size_middle) <= MAX_EXPONENT:
        return "scales", f"the middle size is e^{scene.size_middle:g}, accepted are e^±{MAX_EXPONENT:g}"
    if not (np.isfinite(scene.mean).all() and np.isfinite(scene.basis).all()):
        return "sh", "a number of mean or basis is not finite"
    return next((fault for tier in scene.tiers if (fault := _channel_fault(scene, tier))), None)


def _channel_fault(scene: ListScene, tier: Tier) -> tuple[str, str] | None:
    reach = {c.record.key: _reach(scene, c) for c in tier.channels}
    colours = np.array([reach[PlaneClass.COLOR, target] for target in range(scene.basis.shape[1])])
    sh = np.abs(scene.mean.astype(np.float64)) + np.abs(scene.basis.astype(np.float64)) @ colours
    values = [
        ("sh", "sh", float(sh.max()), MAX_DECODED),
        ("quats", "rotations", max(reach[PlaneClass.ROTATION, target] for target in range(3)), 1e15),
        ("opacities", "opacities", reach[PlaneClass.OPACITY, 0], MAX_DECODED),
        *(("scales", f"scales {target}", reach[PlaneClass.SCALE, target], MAX_DECODED) for target in range(3)),
    ]
    for attribute, name, value, bound in values:
        if not value <= bound:
            return attribute, f"{name} can decode to {value:.3g}, accepted is at most {bound:g}"
    return None


def _grid_fault(grid: PointGrid, levels: int) -> str:
    """What is wrong with a grid's numbers, or nothing."""
    if not (np.abs(grid.centre) <= MAX_DECODED).all():
        return f"centre {grid.centre.tolist()}, at most {MAX_DECODED:g} accepted"
    if not (0 < grid.radius < MAX_DECODED and 0 < grid.cell <= 1):
        return f"radius {grid.radius:g} or cell {grid.cell:g} out of range"
    reach = float(np.abs(grid.low).max()) + grid.cell * (1 << levels)
    largest = grid.radius * math.exp(min(reach, MAX_EXPONENT)) + float(np.abs(grid.centre).max())
    return "" if reach <= MAX_EXPONENT and largest <= MAX_DECODED else "positions can decode to more than 1e30"


def _reach(scene: ListScene, channel: ListChannel) -> float:
    """Largest magnitude that a channel can decode to."""
    record = channel.record
    order = order_of(*record.key)
    gain = max(map(abs, scene.orders[order - 1].gains)) if order else 1.0
    coded = abs(record.offset) + (MAX_CODE * abs(record.scale) if record.pictures else 0.0)
    return gain * coded + abs(channel.centre)
