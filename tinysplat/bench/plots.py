"""The report's plots: error or dB against seconds, one PNG each, a few ten KB."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from .timing import Row
from .views import VIEWS, View

_COLOURS = ("#1b6ca8", "#d1495b", "#2a9d54", "#8f5bb5", "#c7861f", "#4d4d4d", "#12a0a8", "#a33d8f")
_MARKERS = "osD^vPX*"
_DPI = 100

EXACT_DB = 100
"""Above it a format is exact but for float32's rounding; its dB would flatten all others."""


def plot_stage(path: Path, stage: str, rows: Sequence[Row]) -> None:
    """One stage over all its cases: the view's figure against seconds, a panel per case."""
    cases = list(dict.fromkeys(row.case for row in rows))
    figure = _figure(4.6 * len(cases) + 0.4, 3.9)
    for i, case in enumerate(cases):
        axes = figure.add_subplot(1, len(cases), i + 1)
        _scatter(axes, VIEWS[stage], [row for row in rows if row.case == case])
        axes.set_title(case, fontsize=9)
    _save(figure, path)


def plot_overview(path: Path, rows: Sequence[Row]) -> None:
    """Up to four panels: the chain, encoding, the rasteriser, and peers; those that were measured."""
    panels = [
        panel
        for panel in (_chain_panel, _encode_panel, _raster_panel, _peer_panel)
        if panel(None, rows)  # a panel says whether it has anything to show
    ]
    if not panels:
        return
    columns = min(2, len(panels))
    figure = _figure(5.4 * columns, 4.1 * math.ceil(len(panels) / columns))
    for i, panel in enumerate(panels):
        panel(figure.add_subplot(math.ceil(len(panels) / columns), columns, i + 1), rows)
    _save(figure, path)


def plot_growth(path: Path, rows: Sequence[Row]) -> None:
    """Seconds (above) and peak memory (below) against each axis, log-log, with a line of slope 1."""
    growing = [row for row in rows if row.stage.startswith("growth ") and row.stage != "growth plane"]
    axes_names = list(dict.fromkeys(row.case for row in growing))
    has_peaks = any(row.peak_bytes for row in growing)
    figure = _figure(4.2 * len(axes_names) + 0.4, 6.4 if has_peaks else 3.4)
    for i, name in enumerate(axes_names):
        members = [row for row in growing if row.case == name]
        _growth_panel(figure.add_subplot(1 + has_peaks, len(axes_names), i + 1), name, members, is_memory=False)
        if any(row.peak_bytes for row in members):
            axes = figure.add_subplot(2, len(axes_names), len(axes_names) + i + 1)
            _growth_panel(axes, name, members, is_memory=True)
    _save(figure, path)


def _growth_panel(axes: Any, name: str, rows: Sequence[Row], *, is_memory: bool) -> None:
    for i, stage in enumerate(dict.fromkeys(row.stage for row in rows)):
        points = [
            (row.settings["x"], row.peak_bytes / 1e6 if is_memory and row.peak_bytes else row.seconds.median)
            for row in rows
            if row.stage == stage and row.seconds is not None and (row.peak_bytes or not is_memory)
        ]
        if not points:
            continue
        x, y = zip(*points, strict=True)
        colour = _COLOURS[i % len(_COLOURS)]
        axes.plot(x, y, marker=_MARKERS[i % len(_MARKERS)], color=colour, label=stage.removeprefix("growth "), lw=1.2)
        if not is_memory:
            axes.plot(x, [y[-1] * value / x[-1] for value in x], color=colour, ls=":", lw=0.7)
    _logarithmic(axes.xaxis)
    _logarithmic(axes.yaxis)
    axes.grid(True, which="major", alpha=0.3)
    axes.set_xlabel(name)
    axes.set_ylabel("peak memory, MB" if is_memory else "seconds")
    axes.legend(fontsize=8)


def _logarithmic(axis: Any) -> None:
    """A log scale whose ticks are plain numbers, 1, 2 and 5 of every decade."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}" if value < 1e4 else f"{value / 1000:g}k"))
    axis.set_minor_formatter(NullFormatter())


def _scatter(axes: Any, view: View, rows: Sequence[Row]) -> None:
    """Points by group; where there are no groups and few points, a point's label is its variant."""
    assert view.y is not None
    shown = [row for row in rows if row.seconds is not None and math.isfinite(row.figures.get(view.y, math.nan))]
    groups = list(dict.fromkeys(str(row.settings.get(view.group, "")) if view.group else "" for row in shown))
    for i, group in enumerate(groups):
        members = [row for row in shown if not view.group or str(row.settings.get(view.group, "")) == group]
        x = [row.seconds.median for row in members if row.seconds]
        y = [row.figures[view.y] for row in members]
        spread = [
            [row.seconds.median - row.seconds.low for row in members if row.seconds],
            [row.seconds.high - row.seconds.median for row in members if row.seconds],
        ]
        marker, colour = _MARKERS[i % len(_MARKERS)], _COLOURS[i % len(_COLOURS)]
        axes.errorbar(x, y, xerr=spread, fmt="none", ecolor=colour, lw=0.8)
        if view.group and len(members) > 2:
            axes.plot(x, y, color=colour, lw=0.6, alpha=0.6)
        axes.scatter(x, y, _areas(members, shown), color=colour, marker=marker, alpha=0.8, label=group or None)
        if len(shown) <= 12 and not view.group:
            for row in members:
                _name(axes, row, view.y)
    axes.margins(x=0.25, y=0.12)
    _logarithmic(axes.xaxis)
    if view.is_log:
        axes.set_yscale("log")
    axes.set_xlabel("seconds, median and quartiles" + ("; area: bytes" if _has_bytes(view, shown) else ""))
    axes.set_ylabel(view.y_label)
    axes.grid(True, which="major", alpha=0.3)
    if any(groups):
        axes.legend(fontsize=8)


def _has_bytes(view: View, rows: Sequence[Row]) -> bool:
    return view.y != "bytes" and any("bytes" in row.figures for row in rows)


def _areas(rows: Sequence[Row], among: Sequence[Row]) -> list[float]:
    """Marker areas in points²: in proportion to bytes where there are any."""
    largest = max((row.figures.get("bytes", 0) for row in among), default=0)
    return [max(12, 160 * row.figures.get("bytes", 0) / largest) if largest else 30 for row in rows]


def _name(axes: Any, row: Row, key: str) -> None:
    assert row.seconds is not None
    at = (row.seconds.median, row.figures[key])
    axes.annotate(row.variant, at, xytext=(4, 4), textcoords="offset points", fontsize=6.5, alpha=0.85)


def _of(rows: Sequence[Row], stage: str, key: str) -> list[Row]:
    """Measured rows of the stage's first case that have a finite figure `key`."""
    found = [
        row for row in rows if row.stage == stage and math.isfinite(row.figures.get(key, math.nan)) and row.seconds
    ]
    return [row for row in found if row.case == found[0].case]


def _chain_panel(axes: Any, rows: Sequence[Row]) -> bool:
    shown = _of(rows, "chain", "psnr")
    if axes is not None:
        _scatter(axes, VIEWS["chain"], shown)
        axes.set_title(f"photos to picture: {shown[0].case}", fontsize=9)
    return bool(shown)


def _encode_panel(axes: Any, rows: Sequence[Row]) -> bool:
    shown = _of(rows, "encode", "psnr_decoded_raw")
    if axes is not None:
        _scatter(axes, VIEWS["encode"], shown)
        axes.set_title(f"encoding: {shown[0].case}", fontsize=9)
    return bool(shown)


def _raster_panel(axes: Any, rows: Sequence[Row]) -> bool:
    shown = [row for row in rows if row.stage == "rasteriser" and row.seconds and row.figures.get("error_999", 0) > 0]
    if axes is None:
        return bool(shown)
    ways = [row.variant for row in shown if row.case == shown[0].case]
    for i, way in enumerate(ways):
        members = [row for row in shown if row.variant == way]
        x = [row.seconds.median for row in members if row.seconds]
        colour = _COLOURS[i]
        axes.plot(x, [r.figures["error_999"] for r in members], "o", color=colour, label=f"99.9 %: {way}")
        axes.plot(x, [r.figures["median_error"] for r in members], "x", color=colour, label=f"median: {way}")
    _logarithmic(axes.xaxis)
    axes.set_yscale("log")
    axes.set_xlabel("seconds a frame")
    axes.set_ylabel("error against float64")
    axes.set_title("rasteriser: picture sizes and numbers of Gaussians", fontsize=9)
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize=7)
    return True


def _peer_panel(axes: Any, rows: Sequence[Row]) -> bool:
    shown = [row for row in _of(rows, "peers encode", "psnr_decoded_raw") if row.figures["psnr_decoded_raw"] < EXACT_DB]
    if axes is None:
        return bool(shown)
    ours = [row for row in shown if row.variant.startswith("TinySplat")]
    for i, row in enumerate([*ours, *(row for row in shown if row not in ours)]):
        colour = _COLOURS[0] if row in ours else _COLOURS[1 + i % (len(_COLOURS) - 1)]
        at = (row.figures["bytes"] / 1000, row.figures["psnr_decoded_raw"])
        axes.plot(*at, _MARKERS[i % len(_MARKERS)], color=colour, ms=6, alpha=0.8, ls="none", label=row.variant)
    axes.margins(x=0.1, y=0.15)
    axes.legend(fontsize=6.5)
    _logarithmic(axes.xaxis)
    axes.set_xlabel("KB")
    axes.set_ylabel("dB to raw")
    axes.set_title(f"peers: {shown[0].case}", fontsize=9)
    axes.grid(True, which="major", alpha=0.3)
    return True


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Software": None})
