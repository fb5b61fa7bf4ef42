"""Tables of rate–distortion rows: bytes at equal dB, BD-rate, bytes for what is lost against photos, bits by class, and
what each idea gains.

The first way of a group of rows is the reference. Figures are taken window by window and then averaged, shares of bytes
geometrically, because windows differ in the dB that they reach. Where curves do not meet, the table says so.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence

import numpy as np

from tinysplat_runtime.errors import InputError

from ..curves import Point, bd_rate, bytes_at
from ..rows import Row, grouped
from .tables import ABSENT, format_table, number

EQUAL_DB = (38.0, 39.0, 40.0, 41.0)
LOSSES_DB = (0.5, 0.2, 0.1)
"""dB lost against photos, of what the raw Gaussians reach."""

PHOTO_OVERLAP_DB = 0.2
"""Against photos curves are flat: what the network is worth hides what coding costs."""

TO_RAW, TO_PHOTO = "psnr_decoded_raw", "psnr"
_OVERVIEW_DB = (39.0, 41.0)
_SHARES = ("position", "scale", "rotation", "color", "opacity", "photos")

Windows = Mapping[str, Mapping[str, Sequence[Point]]]
"""Curves by window and way; the first way of a window is the reference."""


def measured(rows: Sequence[Row], study: str) -> list[Row]:
    """Rows of a study that have figures."""
    return [row for row in rows if row.study == study and row.figures]


def _windows(rows: Sequence[Row], key: str = TO_RAW) -> Windows:
    return {
        case: {
            way: [(row.figures["bytes"], row.figures[key]) for row in points if row.figures.get(key) is not None]
            for (way,), points in grouped(members, "way").items()
        }
        for (case,), members in grouped(rows, "subject").items()
    }


def _reference(curves: Mapping[str, Sequence[Point]]) -> Sequence[Point]:
    return next(iter(curves.values()))


def overview_table(rows: Sequence[Row]) -> str:
    """BD-rate and bytes of the ways that have curves, by network and number of views; empty where only one has."""
    rows = measured(rows, "curves")
    limits = EQUAL_DB[0], EQUAL_DB[-1]
    ways = [way for (way,), members in grouped(rows, "way").items() if len(members) > len(_windows(members))]
    if len(ways) < 2:
        return ""
    table = []
    for (network, views), members in grouped(rows, "network", "views").items():
        windows, name = _windows(members), f"{network}, {views} views"
        rates = [_rate_cell(windows, way, limits) for way in ways[1:]]
        table.append([name, f"BD-rate {limits[0]:g}–{limits[1]:g} dB", ABSENT, *rates])
        for db in _OVERVIEW_DB:
            sizes = [_size_cell(windows, way, dict.fromkeys(windows, db)) for way in ways]
            table.append([name, f"KB at {db:g} dB", *sizes])
    return format_table(["", "", *ways], table)


def group_tables(rows: Sequence[Row]) -> str:
    """All tables of each network and number of views."""
    sections = []
    for (network, views), members in grouped(measured(rows, "curves"), "network", "views").items():
        cases = ", ".join(dict.fromkeys(row.subject for row in members))
        tables = (rate_table(members), single_table(members), photo_table(members), bits_table(members))
        sections.append("\n\n".join([f"### {network}, {views} views: {cases}", *filter(None, tables)]))
    return "\n\n".join(sections)


def rate_table(rows: Sequence[Row]) -> str:
    """Bytes at equal PSNR of decoded against raw, and BD-rate against the first way; rows of one network and count."""
    windows, table = _windows(rows), []
    for way in dict.fromkeys(row.way for row in rows):
        cells = [_size_cell(windows, way, dict.fromkeys(windows, db)) for db in EQUAL_DB]
        rates = [_rate_cell(windows, way, limits) for limits in ((EQUAL_DB[0], EQUAL_DB[-1]), None)]
        table.append([way, _span(windows, way), *cells, *rates])
    labels = [f"KB at {db:g} dB" for db in EQUAL_DB]
    return format_table(["", "dB", *labels, f"BD-rate {EQUAL_DB[0]:g}–{EQUAL_DB[-1]:g} dB", "BD-rate, all"], table)


def photo_table(rows: Sequence[Row]) -> str:
    """Bytes by what is lost against photos; empty where there are no photos."""
    rows = [row for row in rows if row.figures.get(TO_PHOTO) is not None]
    if not rows:
        return ""
    raw = {case: members[0].figures["psnr_raw"] for (case,), members in grouped(rows, "subject").items()}
    windows, table = _windows(rows, TO_PHOTO), []
    for way in dict.fromkeys(row.way for row in rows):
        cells = [_size_cell(windows, way, {case: db - loss for case, db in raw.items()}) for loss in LOSSES_DB]
        table.append([way, _span(windows, way), *cells, _rate_cell(windows, way, None, PHOTO_OVERLAP_DB)])
    header = ["", "dB to photo", *(f"KB at {loss:g} dB lost" for loss in LOSSES_DB), "BD-rate, all"]
    mean = number(statistics.fmean(raw.values()), 2)
    return f"The raw Gaussians reach {mean} dB to the photos.\n\n{format_table(header, table)}"


def bits_table(rows: Sequence[Row]) -> str:
    """Every point, means over windows: dB, and each class's percentage of the pictures' bytes."""
    table = []
    for (way, qp), members in grouped(rows, "way", "qp").items():
        points = [row.figures for row in members if row.figures["classes"]]
        if not points:
            continue
        sizes = {name: statistics.fmean(p["classes"][name] for p in points) for name in points[0]["classes"]}
        sizes["position"] = sizes["depth"] + sizes["offset"]
        total = sum(sizes[name] for name in _SHARES if name in sizes)
        seen = [p[TO_PHOTO] for p in points if p.get(TO_PHOTO) is not None]
        cells = [
            number(statistics.fmean(p["bytes"] for p in points) / 1000, 1),
            number(statistics.fmean(p[TO_RAW] for p in points), 2),
            number(statistics.fmean(seen) if seen else None, 2),
        ]
        shares = [number(100 * sizes[c] / total if c in sizes else None, 1) for c in _SHARES]
        table.append([way, f"{qp:g}", *cells, *shares])
    return format_table(["", "Q_g", "KB", "dB to raw", "dB to photo", *_SHARES], table)


def single_table(rows: Sequence[Row]) -> str:
    """Formats of one size: bytes against what the first way needs for the same dB; empty where there are none."""
    windows, table = _windows(rows), []
    for way in dict.fromkeys(row.way for row in rows):
        points = {case: curves[way][0] for case, curves in windows.items() if len(curves.get(way, ())) == 1}
        if points:
            size, db = (statistics.fmean(values) for values in zip(*points.values(), strict=True))
            table.append([way, number(size / 1000, 1), number(db, 2), _multiple(windows, points)])
    return format_table(["", "KB", "dB", f"times `{rows[0].way}` at the same dB"], table) if table else ""


def gain_table(rows: Sequence[Row]) -> str:
    """What every idea gains: bytes of the codec without it over those with it at the same dB, by network and views."""
    rows = measured(rows, "ideas")
    groups = grouped(rows, "network", "views")
    ways = list(dict.fromkeys(row.way for row in rows))[1:]
    table = [[way, *(_gain_cell(_windows(members), way) for members in groups.values())] for way in ways]
    header = ["undone", *(f"{network}, {views} views" for network, views in groups)]
    return format_table(header, table) if table else ""


def _gain_cell(windows: Windows, way: str) -> str:
    """Mean share of bytes above the reference's at the dB of a way's points; a point itself where there is none."""
    gains, beyond = [], []
    for curves in windows.values():
        for size, db in curves.get(way, ()):
            reference = bytes_at(_reference(curves), db)
            if reference is None:
                beyond.append(f"{size / 1000:.0f} KB at {db:.1f} dB")
            else:
                gains.append(size / reference - 1)
    if not gains:
        return beyond[0] if beyond else ABSENT
    return f"{statistics.fmean(gains):+.1%}{_range(gains)}"


def _multiple(windows: Windows, points: Mapping[str, Point]) -> str:
    factors, beyond = [], []
    for case, (size, db) in points.items():
        reference = _reference(windows[case])
        wanted = bytes_at(reference, db)
        if wanted is None:
            best = max(reference, key=lambda p: p[1])
            beyond.append(f"{size / best[0]:.2f} × its {best[1]:.1f} dB")
        else:
            factors.append(size / wanted)
    text = [f"{statistics.geometric_mean(factors):.2f} ×" + _counted(len(factors), len(points))] if factors else []
    return "; ".join([*text, *(f"beyond its curve: {entry}" for entry in beyond)])


def _span(windows: Windows, way: str) -> str:
    """Means over windows of the ends of the curves."""
    ends = [[f(db for _, db in curves[way]) for f in (min, max)] for curves in windows.values() if curves.get(way)]
    low, high = np.mean(ends, axis=0)
    return f"{low:.1f}" if low == high else f"{low:.1f}–{high:.1f}"


def _size_cell(windows: Windows, way: str, decibels: Mapping[str, float]) -> str:
    """Mean KB at each window's dB, and the share of the reference's bytes over the windows where both reach it."""
    sizes, shares = [], []
    for case, curves in windows.items():
        size, reference = (bytes_at(points, decibels[case]) for points in (curves.get(way, ()), _reference(curves)))
        if size is not None:
            sizes.append(size)
            shares += [] if reference is None else [size / reference]
    if not sizes:
        return ABSENT
    share = f" ({statistics.geometric_mean(shares):.0%})" if shares else ""
    return f"{statistics.fmean(sizes) / 1000:.1f}{share}{_counted(len(sizes), len(windows))}"


def _rate_cell(windows: Windows, way: str, limits: tuple[float, float] | None, least_overlap: float = 0.5) -> str:
    """Mean BD-rate with its range over windows; why there is none."""
    rates, refused = [], ""
    for curves in windows.values():
        if way in curves:
            try:
                rates.append(bd_rate(_reference(curves), curves[way], limits, least_overlap))
            except InputError as error:
                refused = error.message.partition(",")[0]
    if not rates:
        return refused or ABSENT
    mean = math.expm1(statistics.fmean(map(math.log1p, rates)))
    return f"{mean:+.1%}{_range(rates)}{_counted(len(rates), len(windows))}"


def _range(shares: Sequence[float]) -> str:
    return f" ({min(shares):+.0%} to {max(shares):+.0%})" if len(shares) > 1 else ""


def _counted(count: int, total: int) -> str:
    return "" if count == total else f", {count} of {total}"
