"""Sections of mode free: Gaussians that belong to no pixels. Layout: docs/FORMAT.md, `FREE`, `TIER` and `FREP`.

Reading checks every number and length against limits before anything is decoded, and shows by the numbers' ranges that
nothing can come to more than float32 holds.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ..gaussian.planes import MAX_CODE, MAX_DECODED, MAX_QP, PlaneClass
from ..gaussian.sh import MAX_SH_DEGREE
from .layout import CHANNEL, CONSTANT, INTRA, PARAMETER_SETS, PLANES, STREAM
from .records import ChannelRecord, FreeChannel, FreeScene, FreeTier, Limits, PointGrid, StreamRef, WeightClasses
from .sections import Cursor, NewSection, Section, only, require

FREE = b"FREE"
FREE_TIER = b"TIER"
FREE_POINTS = b"FREP"

FREE_FIXED = struct.Struct("<IBBHH6sIIddddddddf")
"""count, SH degree, levels, channels, k, reserved (0), leaves, escapes, centre (3), radius, cell, low (3), and
size_middle."""

FREE_MINOR = 4
"""Minor version of a file of mode free, whose sections readers before it refuse."""

TIER_FIXED = struct.Struct("<IBBHIIdf")
"""count, levels, reserved (0), reserved (0), leaves, escapes, cell, growth."""

TIER_MINOR = 6
"""Minor version of a file of several tiers."""

MAX_TIERS = 16

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
CENTRE = struct.Struct("<f")

TARGETS = {PlaneClass.OPACITY: 1, PlaneClass.SCALE: 3, PlaneClass.ROTATION: 3}
"""Channels of each class but colour: √opacity; size, length, thickness; a rotation's vector part."""

DETERMINING = ((PlaneClass.OPACITY, 0), (PlaneClass.SCALE, 0), (PlaneClass.SCALE, 1))
"""Channels that say how much a Gaussian weighs: opacity, size, length."""


def order_of(plane_class: PlaneClass, target: int) -> int:
    """How many determinants a channel's order follows: 0 is the curve alone."""
    if plane_class == PlaneClass.ROTATION:
        return 3
    if plane_class == PlaneClass.OPACITY:
        return 0
    return 1 if (plane_class, target) == (PlaneClass.SCALE, 0) else 2


def free_sections(
    scene: FreeScene, payloads: Sequence[Mapping[tuple[PlaneClass, int], bytes]], parameter_sets: Sequence[bytes]
) -> list[NewSection]:
    """The sections of a scene: metadata, then its tiers such that a prefix shows as much as it can.

    Args:
        scene: what they hold.
        payloads: by tier, the pictures of the channels that are no numbers.
        parameter_sets: by tier; empty where there are no pictures.
    """
    first, k = scene.tiers[0], scene.basis.shape[1]
    grid = first.grid
    fixed = FREE_FIXED.pack(
        first.count, scene.degree, len(grid.levels), len(first.channels), k, b"", grid.leaves, grid.escapes,
        *grid.centre, grid.radius, grid.cell, *grid.low, scene.size_middle,
    )  # fmt: skip
    shared = [COUNT.pack(len(values)) + values.astype("<f4").tobytes() for values in scene.thresholds]
    for order in scene.orders:
        shared.append(COUNT.pack(order.first) + COUNT.pack(len(order.gains)) + np.array(order.gains, "<f4").tobytes())
    shared += [scene.mean.astype("<f4").tobytes(), np.ascontiguousarray(scene.basis, "<f2").tobytes()]
    parts = [fixed, _packed_points(grid), *shared, _packed_channels(first, payloads[0])]
    metadata = [NewSection(FREE, 0, b"".join(parts), FREE_MINOR)]
    for number, tier in enumerate(scene.tiers[1:], start=1):
        grid = tier.grid
        fixed = TIER_FIXED.pack(tier.count, len(grid.levels), 0, 0, grid.leaves, grid.escapes, grid.cell, tier.growth)
        data = b"".join((fixed, _packed_points(grid), _packed_channels(tier, payloads[number])))
        metadata.append(NewSection(FREE_TIER, number, data, TIER_MINOR))
    metadata += [NewSection(PARAMETER_SETS, number, sets) for number, sets in enumerate(parameter_sets) if sets]
    return metadata + [
        section for number, tier in enumerate(scene.tiers) for section in _tier_sections(number, tier, payloads[number])
    ]


def _packed_points(grid: PointGrid) -> bytes:
    streams = [STREAM.pack(len(stream), crc32(stream)) for stream in grid.streams]
    return np.array(grid.levels, "<u4").tobytes() + b"".join(streams)


def _packed_channels(tier: FreeTier, payloads: Mapping[tuple[PlaneClass, int], bytes]) -> bytes:
    parts = []
    for channel in tier.channels:
        record = channel.record
        payload = payloads.get(record.key)
        coding = CONSTANT if payload is None else INTRA
        parts.append(CHANNEL.pack(record.plane_class, record.target, coding, record.qp, record.scale, record.offset))
        parts.append(CENTRE.pack(channel.centre))
        if payload is not None:
            parts.append(STREAM.pack(len(payload), crc32(payload)))
    return b"".join(parts)


def _tier_sections(
    number: int, tier: FreeTier, payloads: Mapping[tuple[PlaneClass, int], bytes]
) -> Iterator[NewSection]:
    yield NewSection(FREE_POINTS, number, b"".join(map(bytes, tier.grid.streams)))
    for plane_class in (PlaneClass.OPACITY, PlaneClass.SCALE, PlaneClass.COLOR, PlaneClass.ROTATION):
        if data := b"".join(p for (c, _), p in sorted(payloads.items()) if c == plane_class):
            yield NewSection(PLANES[plane_class], number, data)


def read_free(sections: Sequence[Section], limits: Limits) -> FreeScene:
    """Parse and check the sections FREE, TIER and FREP.

    Raises:
        FormatError: damaged, or beyond the limits.
    """
    cursor, tiers = Cursor(only(sections, FREE)), _tier_cursors(sections)
    count, degree, n_levels, n_channels, k, _, leaves, escapes, *numbers = cursor.unpack(FREE_FIXED)
    fixed = [tier.unpack(TIER_FIXED) for tier in tiers]
    for tier, (number, *_) in zip(tiers, fixed, strict=True):
        tier.require(number > 0, "0 Gaussians, accepted are 1 and more")
    total = count + sum(number for number, *_ in fixed)
    d = 3 * (degree + 1) ** 2
    cursor.require(degree <= MAX_SH_DEGREE, f"SH degree {degree}, accepted are 0 to {MAX_SH_DEGREE}")
    most = limits.max_pixels
    cursor.require(count >= 1 and total <= most, f"{total} Gaussians, accepted are 1 to {most} (--max-pixels)")
    paid = MAX_PER_BYTE * sum(len(section.data) for section in sections)
    cursor.require(total <= paid, f"{total} Gaussians, the file's bytes stand for {paid} at most")
    cursor.require(k <= d, f"k = {k}, accepted are 0 to {d}")
    cursor.require(n_channels == 7 + k, f"{n_channels} channels, expected {7 + k}")
    memory, most = decoding_bytes(total, degree, k), limits.max_memory_bytes
    cursor.require(memory <= most, f"{memory} bytes to decode, the limit is {most} (--max-memory)")
    *centre, radius, cell, low_x, low_y, low_z, middle = numbers
    space = PointGrid(np.array(centre), radius, cell, np.array([low_x, low_y, low_z]), (), leaves, escapes, ())
    grid = _read_grid(cursor, only(sections, FREE_POINTS), space, n_levels, count)
    thresholds = tuple(_read_floats(cursor, MAX_THRESHOLDS, "thresholds") for _ in DETERMINING)
    for values in thresholds:
        cursor.require(bool((np.diff(values) > 0).all()), "thresholds do not rise")
    orders = tuple(_read_order(cursor) for _ in DETERMINING)
    mean = np.frombuffer(cursor.take(4 * d), "<f4")
    basis = np.frombuffer(cursor.take(2 * d * k), "<f2").reshape(d, k)
    found = [FreeTier(count, grid, _read_channels(cursor, k))]
    for index, (tier, row) in enumerate(zip(tiers, fixed, strict=True), start=1):
        found.append(_read_tier(tier, row, only(sections, FREE_POINTS, index), grid, k))
    for section in sections:
        where = section.kind == FREE_POINTS and section.index > len(tiers)
        cursor.require(not where, f"{section.label} holds positions of no tier")
    for each in (cursor, *tiers):
        each.finish()
    scene = FreeScene(degree, middle, thresholds, orders, mean, basis, tuple(found))
    fault = range_fault(scene)
    cursor.require(fault is None, fault[1] if fault else "")
    return scene


def _tier_cursors(sections: Sequence[Section]) -> list[Cursor]:
    """The sections TIER, which have the numbers 1, 2, 3, …"""
    found = sorted((s for s in sections if s.kind == FREE_TIER), key=lambda section: section.index)
    for number, section in enumerate(found, start=1):
        require(section.index == number < MAX_TIERS, section, f"expected TIER[{number}], of at most {MAX_TIERS - 1}")
    return [Cursor(section) for section in found]


def _read_tier(cursor: Cursor, fixed: Sequence, points: Section, shared: PointGrid, k: int) -> FreeTier:
    count, n_levels, _, _, leaves, escapes, cell, growth = fixed
    cursor.require(0 <= growth <= MAX_GROWTH, f"growth {growth:g}, accepted are 0 to {MAX_GROWTH:g}")
    space = replace(shared, cell=cell, leaves=leaves, escapes=escapes)
    grid = _read_grid(cursor, points, space, n_levels, count)
    return FreeTier(count, grid, _read_channels(cursor, k), growth)


def decoding_bytes(count: int, degree: int, k: int) -> int:
    """Memory that decoding takes: the Gaussians, codes and numbers that they come from, and cells of the octree."""
    d = 3 * (degree + 1) ** 2
    return count * (4 * (11 + d) + 2 * (7 + k) + 8 * (16 + k) + 64)


def _read_grid(cursor: Cursor, points: Section, space: PointGrid, n_levels: int, count: int) -> PointGrid:
    """The grid whose fixed fields `space` has, with levels and streams."""
    cursor.require(1 <= n_levels <= MAX_LEVELS, f"{n_levels} levels, accepted are 1 to {MAX_LEVELS}")
    fault = _grid_fault(space, n_levels)
    cursor.require(not fault, fault)
    levels = np.frombuffer(cursor.take(4 * n_levels), "<u4").astype(np.int64)
    leaves, escapes = space.leaves, space.escapes
    chain = np.array([*levels, leaves])
    fits = levels[0] == 1 and bool((np.diff(chain) >= 0).all()) and bool((chain[1:] <= 8 * chain[:-1]).all())
    cursor.require(fits, "the octree's levels do not grow as an octree's do")
    cursor.require(
        leaves <= count and escapes <= leaves, f"{leaves} leaves and {escapes} escapes for {count} Gaussians"
    )
    streams, end = [], 0
    is_at_hand = len(points.data) == points.length  # not where a prefix ends before or in it
    for number in range(POINT_STREAMS):
        length, crc = cursor.unpack(STREAM)
        data = points.data[end : end + length]
        is_right = not is_at_hand or (len(data) == length and crc32(data) == crc)
        cursor.require(is_right, f"stream {number} of the positions was altered")
        streams.append(data)
        end += length
    cursor.require(end == points.length, f"{points.length} bytes of positions, {end} announced")
    return replace(space, levels=tuple(levels.tolist()), streams=tuple(streams) if is_at_hand else ())


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


def _read_channels(cursor: Cursor, k: int) -> tuple[FreeChannel, ...]:
    expected = [(PlaneClass.COLOR, target) for target in range(k)]
    expected += [(c, target) for c, targets in TARGETS.items() for target in range(targets)]
    ends = dict.fromkeys(PlaneClass, 0)
    channels = []
    for plane_class, target in expected:
        number, found, coding, qp, scale, offset = cursor.unpack(CHANNEL)
        (centre,) = cursor.unpack(CENTRE)
        name = f"{plane_class.label}{target}"
        cursor.require((number, found) == (plane_class, target), f"class {number}, channel {found}; expected {name}")
        cursor.require(coding in (CONSTANT, INTRA), f"coding {coding} is unknown")
        cursor.require(qp <= MAX_QP, f"QP {qp}, accepted are 0 to {MAX_QP}")
        finite = all(abs(value) < MAX_DECODED for value in (scale, offset, centre))
        cursor.require(finite, f"{name}: scale, offset or centre out of range")
        streams: tuple[StreamRef, ...] = ()
        if coding == INTRA:
            length, crc = cursor.unpack(STREAM)
            streams = (StreamRef(ends[plane_class], length, crc),)
            ends[plane_class] += length
        channels.append(FreeChannel(ChannelRecord(plane_class, target, qp, scale, offset, streams), centre))
    return tuple(channels)


def range_fault(scene: FreeScene) -> tuple[str, str] | None:
    """Which attribute could decode, by some codes, to what float32 does not hold, and to what; None if none could."""
    for tier in scene.tiers:
        if found := _grid_fault(tier.grid, len(tier.grid.levels)):
            return "means", found
    if not abs(scene.size_middle) <= MAX_EXPONENT:
        return "scales", f"the middle size is e^{scene.size_middle:g}, accepted are e^±{MAX_EXPONENT:g}"
    if not (np.isfinite(scene.mean).all() and np.isfinite(scene.basis).all()):
        return "sh", "a number of mean or basis is not finite"
    return next((fault for tier in scene.tiers if (fault := _channel_fault(scene, tier))), None)


def _channel_fault(scene: FreeScene, tier: FreeTier) -> tuple[str, str] | None:
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


def _reach(scene: FreeScene, channel: FreeChannel) -> float:
    """Largest magnitude that a channel can decode to."""
    record = channel.record
    order = order_of(*record.key)
    gain = max(map(abs, scene.orders[order - 1].gains)) if order else 1.0
    coded = abs(record.offset) + (MAX_CODE * abs(record.scale) if record.streams else 0.0)
    return gain * coded + abs(channel.centre)
