"""Sections of mode free: Gaussians that belong to no pixels. Layout: docs/FORMAT.md, `FREE` and `FREP`.

Reading checks every number and length against limits before anything is decoded, and shows by the numbers' ranges that
nothing can come to more than float32 holds.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ..gaussian.planes import MAX_CODE, MAX_DECODED, MAX_QP, PlaneClass
from ..gaussian.sh import MAX_SH_DEGREE
from .layout import CHANNEL, CONSTANT, INTRA, PARAMETER_SETS, PLANES, STREAM
from .records import ChannelRecord, FreeChannel, FreeScene, Limits, PointGrid, StreamRef, WeightClasses
from .sections import Cursor, NewSection, Section, only

FREE = b"FREE"
FREE_POINTS = b"FREP"

FREE_FIXED = struct.Struct("<IBBHH6sIIddddddddf")
"""count, SH degree, levels, channels, k, reserved (0), leaves, escapes, centre (3), radius, cell, low (3), and
size_middle."""

FREE_MINOR = 4
"""Minor version of a file of mode free, whose sections readers before it refuse."""

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
    scene: FreeScene, payloads: Mapping[tuple[PlaneClass, int], bytes], parameter_sets: bytes
) -> list[NewSection]:
    """The sections of a scene: metadata, positions, and pictures such that a prefix shows as much as it can."""
    grid, k = scene.grid, scene.basis.shape[1]
    fixed = FREE_FIXED.pack(
        scene.count, scene.degree, len(grid.levels), len(scene.channels), k, b"", grid.leaves, grid.escapes,
        *grid.centre, grid.radius, grid.cell, *grid.low, scene.size_middle,
    )  # fmt: skip
    parts = [fixed, np.array(grid.levels, "<u4").tobytes()]
    parts += [STREAM.pack(len(stream), crc32(stream)) for stream in grid.streams]
    parts += [COUNT.pack(len(values)) + values.astype("<f4").tobytes() for values in scene.thresholds]
    for order in scene.orders:
        parts.append(COUNT.pack(order.first) + COUNT.pack(len(order.gains)) + np.array(order.gains, "<f4").tobytes())
    parts += [scene.mean.astype("<f4").tobytes(), np.ascontiguousarray(scene.basis, "<f2").tobytes()]
    for channel in scene.channels:
        record = channel.record
        payload = payloads.get((record.plane_class, record.target))
        coding = CONSTANT if payload is None else INTRA
        parts.append(CHANNEL.pack(record.plane_class, record.target, coding, record.qp, record.scale, record.offset))
        parts.append(CENTRE.pack(channel.centre))
        if payload is not None:
            parts.append(STREAM.pack(len(payload), crc32(payload)))
    sections = [
        NewSection(FREE, 0, b"".join(parts), FREE_MINOR),
        NewSection(FREE_POINTS, 0, b"".join(map(bytes, grid.streams))),
    ]
    if parameter_sets:
        sections.append(NewSection(PARAMETER_SETS, 0, parameter_sets))
    return sections + [
        NewSection(PLANES[plane_class], 0, data)
        for plane_class in (PlaneClass.OPACITY, PlaneClass.SCALE, PlaneClass.COLOR, PlaneClass.ROTATION)
        if (data := b"".join(p for (c, _), p in sorted(payloads.items()) if c == plane_class))
    ]


def read_free(sections: Sequence[Section], limits: Limits) -> FreeScene:
    """Parse and check the sections FREE and FREP.

    Raises:
        FormatError: damaged, or beyond the limits.
    """
    cursor, points = Cursor(only(sections, FREE)), only(sections, FREE_POINTS)
    count, degree, n_levels, n_channels, k, _, leaves, escapes, *numbers = cursor.unpack(FREE_FIXED)
    d = 3 * (degree + 1) ** 2
    cursor.require(degree <= MAX_SH_DEGREE, f"SH degree {degree}, accepted are 0 to {MAX_SH_DEGREE}")
    cursor.require(
        1 <= count <= limits.max_pixels, f"{count} Gaussians, accepted are 1 to {limits.max_pixels} (--max-pixels)"
    )
    paid = MAX_PER_BYTE * sum(len(section.data) for section in sections)
    cursor.require(count <= paid, f"{count} Gaussians, the file's bytes stand for {paid} at most")
    cursor.require(k <= d, f"k = {k}, accepted are 0 to {d}")
    cursor.require(1 <= n_levels <= MAX_LEVELS, f"{n_levels} levels, accepted are 1 to {MAX_LEVELS}")
    cursor.require(n_channels == 7 + k, f"{n_channels} channels, expected {7 + k}")
    memory = decoding_bytes(count, degree, k)
    cursor.require(
        memory <= limits.max_memory_bytes,
        f"{memory} bytes to decode, the limit is {limits.max_memory_bytes} (--max-memory)",
    )
    grid = _read_grid(cursor, points, numbers[:8], n_levels, leaves, escapes, count)
    thresholds = tuple(_read_floats(cursor, MAX_THRESHOLDS, "thresholds") for _ in DETERMINING)
    for values in thresholds:
        cursor.require(bool((np.diff(values) > 0).all()), "thresholds do not rise")
    orders = tuple(_read_order(cursor) for _ in DETERMINING)
    mean = np.frombuffer(cursor.take(4 * d), "<f4")
    basis = np.frombuffer(cursor.take(2 * d * k), "<f2").reshape(d, k)
    channels = _read_channels(cursor, n_channels, k)
    cursor.finish()
    scene = FreeScene(count, degree, grid, numbers[8], thresholds, orders, mean, basis, channels)
    found = range_fault(scene)
    cursor.require(found is None, found[1] if found else "")
    return scene


def decoding_bytes(count: int, degree: int, k: int) -> int:
    """Memory that decoding takes: the Gaussians, codes and numbers that they come from, and cells of the octree."""
    d = 3 * (degree + 1) ** 2
    return count * (4 * (11 + d) + 2 * (7 + k) + 8 * (16 + k) + 64)


def _read_grid(
    cursor: Cursor, points: Section, numbers: Sequence[float], n_levels: int, leaves: int, escapes: int, count: int
) -> PointGrid:
    *centre, radius, cell, low_x, low_y, low_z = numbers
    low = np.array([low_x, low_y, low_z])
    found = _grid_fault(np.array(centre), radius, cell, low, n_levels)
    cursor.require(not found, found)
    levels = np.frombuffer(cursor.take(4 * n_levels), "<u4").astype(np.int64)
    chain = np.array([*levels, leaves])
    fits = levels[0] == 1 and bool((np.diff(chain) >= 0).all()) and bool((chain[1:] <= 8 * chain[:-1]).all())
    cursor.require(fits, "the octree's levels do not grow as an octree's do")
    cursor.require(
        leaves <= count and escapes <= leaves, f"{leaves} leaves and {escapes} escapes for {count} Gaussians"
    )
    streams, end = [], 0
    for number in range(POINT_STREAMS):
        length, crc = cursor.unpack(STREAM)
        data = points.data[end : end + length]
        cursor.require(len(data) == length and crc32(data) == crc, f"stream {number} of the positions was altered")
        streams.append(data)
        end += length
    cursor.require(end == len(points.data), f"{len(points.data)} bytes of positions, {end} announced")
    return PointGrid(np.array(centre), radius, cell, low, tuple(levels.tolist()), leaves, escapes, tuple(streams))


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


def _read_channels(cursor: Cursor, count: int, k: int) -> tuple[FreeChannel, ...]:
    expected = [(PlaneClass.COLOR, target) for target in range(k)]
    expected += [(c, target) for c, targets in TARGETS.items() for target in range(targets)]
    ends = dict.fromkeys(PlaneClass, 0)
    channels = []
    for plane_class, target in expected[:count]:
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
    grid = scene.grid
    if found := _grid_fault(grid.centre, grid.radius, grid.cell, grid.low, len(grid.levels)):
        return "means", found
    if not abs(scene.size_middle) <= MAX_EXPONENT:
        return "scales", f"the middle size is e^{scene.size_middle:g}, accepted are e^±{MAX_EXPONENT:g}"
    if not (np.isfinite(scene.mean).all() and np.isfinite(scene.basis).all()):
        return "sh", "a number of mean or basis is not finite"
    reach = {(c.record.plane_class, c.record.target): _reach(scene, c) for c in scene.channels}
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


def _grid_fault(centre: NDArray, radius: float, cell: float, low: NDArray, levels: int) -> str:
    """What is wrong with a grid's numbers, or nothing."""
    if not (np.abs(centre) <= MAX_DECODED).all():
        return f"centre {centre.tolist()}, at most {MAX_DECODED:g} accepted"
    if not (0 < radius < MAX_DECODED and 0 < cell <= 1):
        return f"radius {radius:g} or cell {cell:g} out of range"
    reach = float(np.abs(low).max()) + cell * (1 << levels)
    if not (reach <= MAX_EXPONENT and radius * math.exp(reach) + float(np.abs(centre).max()) <= MAX_DECODED):
        return "positions can decode to more than 1e30"
    return ""


def _reach(scene: FreeScene, channel: FreeChannel) -> float:
    """Largest magnitude that a channel can decode to."""
    record = channel.record
    order = order_of(record.plane_class, record.target)
    gain = max(map(abs, scene.orders[order - 1].gains)) if order else 1.0
    coded = abs(record.offset) + (MAX_CODE * abs(record.scale) if record.streams else 0.0)
    return gain * coded + abs(channel.centre)
