"""Tables of rate–distortion curves: bytes at equal dB, BD-rate, bytes for what is lost against photos, bits by class,
and what each idea gains.

The first way of a group of rows is the reference. Figures are taken window by window and then averaged, shares of bytes
geometrically, because windows differ in the dB that they reach. Where curves do not meet, the table says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from tinysplat_runtime.errors import InputError

from .curve_rows import Row, grouped, points_of
from .published import BITS
from .rate_distortion import Point, bd_rate, bytes_at, towards_photos
from .tables import ABSENT, format_table, number

EQUAL_DB = (38.0, 39.0, 40.0, 41.0)
LOSSES_DB = (0.5, 0.2, 0.1)
"""dB lost against photos, of what the raw Gaussians reach."""

PHOTO_OVERLAP_DB = 0.2
"""Against photos curves are flat: what the network is worth hides what coding costs."""

_OVERVIEW_DB = (39.0, 41.0)
_POSITION = ("depth", "offset")
_SHARES = ("position", "scale", "rotation", "color", "opacity", "photos")

Curves = Mapping[str, Sequence[Point]]


def overview_table(rows: Sequence[Row]) -> str:
    """BD-rate and bytes of the ways that have curves, by network and number of views; empty where only one has."""
    limits = EQUAL_DB[0], EQUAL_DB[-1]
    ways = [way for (way,), members in grouped(rows, "way").items() if len(points_of(members)) > len(_windows(members))]
    if len(ways) < 2:
        return ""
    table = []
    for (network, views), members in grouped(rows, "network", "views").items():
        windows = _windows(members)
        name, rates = f"{network}, {views} views", [_rate_cell(windows, way, limits) for way in ways[1:]]
        table.append([name, f"BD-rate {limits[0]:g}–{limits[1]:g} dB", ABSENT, *rates])
        for db in _OVERVIEW_DB:
            sizes = [_size_cell(windows, way, dict.fromkeys(windows, db)) for way in ways]
            table.append([name, f"KB at {db:g} dB", *sizes])
    return format_table(["", "", *ways], table)


def rate_table(rows: Sequence[Row]) -> str:
    """Bytes at equal PSNR of decoded against raw, and BD-rate against the first way; rows of one network and count."""
    windows = _windows(rows)
    table = []
    for way in dict.fromkeys(row.way for row in rows):
        cells = [_size_cell(windows, way, dict.fromkeys(windows, db)) for db in EQUAL_DB]
        rates = [_rate_cell(windows, way, limits) for limits in ((EQUAL_DB[0], EQUAL_DB[-1]), None)]
        table.append([way, _span(windows, way), *cells, *rates])
    labels = [f"KB at {db:g} dB" for db in EQUAL_DB]
    return format_table(["", "dB", *labels, f"BD-rate {EQUAL_DB[0]:g}–{EQUAL_DB[-1]:g} dB", "BD-rate, all"], table)


def photo_table(rows: Sequence[Row]) -> str:
    """Bytes by what is lost against photos; empty where there are no photos."""
    rows = [row for row in rows if row.point.to_photo is not None]
    if not rows:
        return ""
    raw = {case: members[0].raw_to_photo or 0.0 for (case,), members in grouped(rows, "case").items()}
    windows = {
        case: {way: towards_photos(points) for way, points in curves.items()} for case, curves in _windows(rows).items()
    }
    table = []
    for way in dict.fromkeys(row.way for row in rows):
        cells = [_size_cell(windows, way, {case: db - loss for case, db in raw.items()}) for loss in LOSSES_DB]
        table.append([way, _span(windows, way), *cells, _rate_cell(windows, way, None, PHOTO_OVERLAP_DB)])
    header = ["", "dB to photo", *(f"KB at {loss:g} dB lost" for loss in LOSSES_DB), "BD-rate, all"]
    mean = number(float(np.mean(list(raw.values()))), 2)
    return f"The raw Gaussians reach {mean} dB to the photos.\n\n{format_table(header, table)}"


def bits_table(rows: Sequence[Row]) -> str:
    """Every point, means over windows, below the paper's: dB, and each class's percentage of the pictures' bytes."""
    table = [
        ["TinySplat, printed", f"{qp}", number(kilobytes, 1), ABSENT, ABSENT, *(_share(shares.get(c)) for c in _SHARES)]
        for qp, (kilobytes, shares) in BITS.items()
    ]
    for (way,), members in grouped(rows, "way").items():
        for setting in dict.fromkeys(row.point.setting for row in members):
            points = [row.point for row in members if row.point.setting == setting and row.point.bytes_by_class]
            if points:
                names = points[0].bytes_by_class
                sizes = {name: float(np.mean([p.bytes_by_class[name] for p in points])) for name in names}
                sizes["position"] = sum(sizes[name] for name in _POSITION)
                total = sum(sizes[name] for name in _SHARES if name in sizes)
                kilobytes, db = (float(np.mean([getattr(p, name) for p in points])) for name in ("bytes", "psnr"))
                shares = (_share(100 * sizes[c] / total if c in sizes else None) for c in _SHARES)
                seen = [p.to_photo for p in points if p.to_photo is not None]
                cells = number(kilobytes / 1000, 1), number(db, 2), number(float(np.mean(seen)) if seen else None, 2)
                table.append([way, f"{setting:g}", *cells, *shares])
    return format_table(["", "Q_g", "KB", "dB to raw", "dB to photo", *_SHARES], table)


def gain_table(rows: Sequence[Row]) -> str:
    """What every idea gains: bytes of the codec without it over those with it at the same dB, by network and views."""
    groups = grouped(rows, "network", "views")
    ways = list(dict.fromkeys(row.way for row in rows))[1:]
    table = [[way, *(_gain_cell(_windows(members), way) for members in groups.values())] for way in ways]
    return format_table(["undone", *(f"{network}, {views} views" for network, views in groups)], table)


def single_table(rows: Sequence[Row]) -> str:
    """Formats of one size: bytes against what the first way needs for the same dB; empty where there are none."""
    windows, table = _windows(rows), []
    for way in dict.fromkeys(row.way for row in rows):
        points = {case: curves[way][0] for case, curves in windows.items() if len(curves.get(way, ())) == 1}
        if points:
            size, db = (float(np.mean([getattr(p, name) for p in points.values()])) for name in ("bytes", "psnr"))
            table.append([way, number(size / 1000, 1), number(db, 2), _multiple(windows, points)])
    if not table:
        return ""
    reference = rows[0].way
    return format_table(["", "KB", "dB", f"times `{reference}` at the same dB"], table)


def _gain_cell(windows: Mapping[str, Curves], way: str) -> str:
    """Mean share of bytes above the reference's at the dB of a way's points; a point itself where there is none."""
    gains, beyond = [], []
    for curves in windows.values():
        for point in curves.get(way, ()):
            reference = _reference(curves)
            size = bytes_at(reference, point.psnr)
            if size is None:
                beyond.append(f"{point.bytes / 1000:.0f} KB at {point.psnr:.1f} dB")
            else:
                gains.append(point.bytes / size - 1)
    if not gains:
        return beyond[0] if beyond else ABSENT
    spread = f" ({min(gains):+.0%} to {max(gains):+.0%})" if len(gains) > 1 else ""
    return f"{float(np.mean(gains)):+.1%}{spread}"


def _multiple(windows: Mapping[str, Curves], points: Mapping[str, Point]) -> str:
    factors, beyond = [], []
    for case, point in points.items():
        reference = _reference(windows[case])
        size = bytes_at(reference, point.psnr)
        if size is None:
            best = max(reference, key=lambda p: p.psnr)
            beyond.append(f"{point.bytes / best.bytes:.2f} × its {best.psnr:.1f} dB")
        else:
            factors.append(point.bytes / size)
    text = [f"{_geometric(factors):.2f} ×" + _counted(len(factors), len(points))] if factors else []
    return "; ".join([*text, *(f"beyond its curve: {entry}" for entry in beyond)])


def _windows(rows: Iterable[Row]) -> dict[str, dict[str, list[Point]]]:
    """Curves by window and way."""
    return {
        case: {way: points_of(found) for (way,), found in grouped(members, "way").items()}
        for (case,), members in grouped(rows, "case").items()
    }


def _reference(curves: Curves) -> Sequence[Point]:
    return next(iter(curves.values()))


def _span(windows: Mapping[str, Curves], way: str) -> str:
    """Means over windows of the ends of the curves."""
    ends = [[f(p.psnr for p in curves[way]) for f in (min, max)] for curves in windows.values() if way in curves]
    low, high = np.mean(ends, axis=0)
    return f"{low:.1f}" if low == high else f"{low:.1f}–{high:.1f}"


def _size_cell(windows: Mapping[str, Curves], way: str, decibels: Mapping[str, float]) -> str:
    """Mean KB at each window's dB, and the share of the reference's bytes over the windows where both reach it."""
    sizes, shares = [], []
    for case, curves in windows.items():
        size, reference = (bytes_at(points, decibels[case]) for points in (curves.get(way, ()), _reference(curves)))
        if size is not None:
            sizes.append(size)
            shares += [] if reference is None else [size / reference]
    if not sizes:
        return ABSENT
    share = f" ({_geometric(shares):.0%})" if shares else ""
    return f"{np.mean(sizes) / 1000:.1f}{share}{_counted(len(sizes), len(windows))}"


def _rate_cell(
    windows: Mapping[str, Curves], way: str, limits: tuple[float, float] | None, least_overlap: float = 0.5
) -> str:
    """Mean BD-rate with its range over windows; why there is none."""
    rates, refused = [], ""
    for curves in windows.values():
        if way not in curves:
            continue
        try:
            rates.append(bd_rate(_reference(curves), curves[way], limits, least_overlap))
        except InputError as error:
            refused = error.message.partition(",")[0]
    if not rates:
        return refused or ABSENT
    spread = f" ({min(rates):+.0%} to {max(rates):+.0%})" if len(rates) > 1 else ""
    mean = math.expm1(float(np.mean(np.log1p(rates))))
    return f"{mean:+.1%}{spread}{_counted(len(rates), len(windows))}"


def _counted(count: int, total: int) -> str:
    return "" if count == total else f", {count} of {total}"


def _geometric(values: Sequence[float]) -> float:
    return math.exp(float(np.mean(np.log(values))))


def _share(value: float | None) -> str:
    return number(value, 1)
