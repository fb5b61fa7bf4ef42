"""Tables of rate–distortion rows: bytes at equal dB, BD-rate, and what each idea gains.

The first way of a group of rows is the reference. Figures are taken window by window and then averaged, shares of bytes
geometrically, because windows differ in the dB that they reach. Where curves do not meet, the table says so.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence

from tinysplat_runtime.errors import InputError

from ..curves import Point, bd_rate, bytes_at
from ..rows import Row, grouped
from .tables import ABSENT, format_table

LIMITS_DB, EQUAL_DB = (38.0, 41.0), (39.0, 41.0)
"""Between which BD-rate is taken, and where bytes are compared."""

TO_RAW, TO_PHOTO = "psnr_decoded_raw", "psnr"

Windows = Mapping[str, Mapping[str, Sequence[Point]]]
"""Curves by window and way; the first way of a window is the reference."""


def measured(rows: Sequence[Row], study: str) -> list[Row]:
    """Rows of a study that have figures."""
    return [row for row in rows if row.study == study and row.figures]


def _windows(rows: Sequence[Row]) -> Windows:
    return {
        case: {
            way: [(row.figures["bytes"], row.figures[TO_RAW]) for row in points]
            for (way,), points in grouped(members, "way").items()
        }
        for (case,), members in grouped(rows, "subject").items()
    }


def _reference(curves: Mapping[str, Sequence[Point]]) -> Sequence[Point]:
    return next(iter(curves.values()))


def overview_table(rows: Sequence[Row]) -> str:
    """BD-rate and bytes of the ways that have curves, by network and number of views; empty where only one has."""
    rows = measured(rows, "curves")
    ways = [way for (way,), members in grouped(rows, "way").items() if len(members) > len(_windows(members))]
    if len(ways) < 2:
        return ""
    table = []
    for (network, views), members in grouped(rows, "network", "views").items():
        windows, name = _windows(members), f"{network}, {views} views"
        rates = [_rate_cell(windows, way) for way in ways[1:]]
        table.append([name, f"BD-rate {LIMITS_DB[0]:g}–{LIMITS_DB[1]:g} dB", ABSENT, *rates])
        for db in EQUAL_DB:
            sizes = [_size_cell(windows, way, db) for way in ways]
            table.append([name, f"KB at {db:g} dB", *sizes])
    return format_table(["", "", *ways], table)


def gain_table(rows: Sequence[Row]) -> str:
    """What every idea gains: bytes of the codec without it over those with it at the same dB, by network and views."""
    rows = measured(rows, "ideas")
    groups = grouped(rows, "network", "views")
    ways = list(dict.fromkeys(row.way for row in rows))[1:]
    table = [[way, *(_gain_cell(_windows(members), way) for members in groups.values())] for way in ways]
    return format_table(["undone", *(f"{network}, {views} views" for network, views in groups)], table) if table else ""


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


def _size_cell(windows: Windows, way: str, db: float) -> str:
    """Mean KB at a window's dB, and the share of the reference's bytes over the windows where both reach it."""
    sizes, shares = [], []
    for curves in windows.values():
        size, reference = (bytes_at(points, db) for points in (curves.get(way, ()), _reference(curves)))
        if size is not None:
            sizes.append(size)
            shares += [] if reference is None else [size / reference]
    if not sizes:
        return ABSENT
    share = f" ({statistics.geometric_mean(shares):.0%})" if shares else ""
    return f"{statistics.fmean(sizes) / 1000:.1f}{share}{_counted(len(sizes), len(windows))}"


def _rate_cell(windows: Windows, way: str) -> str:
    """Mean BD-rate with its range over windows; why there is none."""
    rates, refused = [], ""
    for curves in windows.values():
        if way in curves:
            try:
                rates.append(bd_rate(_reference(curves), curves[way], LIMITS_DB))
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
