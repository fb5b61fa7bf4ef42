"""Plots of evaluations: rate against quality, the paper's figures; drawn with matplotlib without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from tinysplat_runtime.system.files import atomic_path

_COLOURS = ("#4d4d4d", "#2a9d54", "#1b6ca8", "#8f5bb5", "#d1495b", "#c7861f", "#12a0a8", "#a33d8f", "#7a6a00")
_MARKERS = "sv^oDPX*d"

_BINS = 100
_SHOWN = (0.5, 99.5)  # percentiles; a few far points would squeeze all others into one bin


@dataclass(frozen=True)
class Curve:
    """A named line through (KB, dB)."""

    name: str
    points: Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Panel:
    """Curves that share axes.

    Attributes:
        title: above it.
        x_label, y_label: of the axes; x is logarithmic.
        curves: a curve of one point is a mark.
        level: a dashed line across, or None.
    """

    title: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    level: float | None = None


def save_grid(path: Path, title: str, rows: Sequence[Sequence[Panel]]) -> None:
    """Panels in rows; a name has one colour and mark throughout, and the legend stands outside."""
    names = list(dict.fromkeys(curve.name for row in rows for panel in row for curve in panel.curves if curve.points))
    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(3.7 * columns + 1.7, 3.2 * len(rows) + 0.3), layout="constrained")
    figure.suptitle(title, fontsize=10)
    drawn: dict[str, Artist] = {}
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            drawn |= _draw_panel(figure.add_subplot(len(rows), columns, i * columns + j + 1), panel, names)
    figure.legend([drawn[name] for name in names], names, loc="outside right center", fontsize=8)
    _save(path, figure)


def _draw_panel(axis: Axes, panel: Panel, names: Sequence[str]) -> dict[str, Artist]:
    """What stands for each curve in a legend."""
    drawn: dict[str, Artist] = {}
    if panel.level is not None:
        axis.axhline(panel.level, color="black", lw=0.8, ls="--")
    for curve in panel.curves:
        if curve.points:
            n = names.index(curve.name)
            x, y = zip(*sorted(curve.points), strict=True)
            colour, marker = _COLOURS[n % len(_COLOURS)], _MARKERS[n % len(_MARKERS)]
            (line,) = axis.plot(x, y, color=colour, marker=marker, markersize=4, lw=1.2)
            drawn[curve.name] = line
    axis.set_xscale("log")
    axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_title(panel.title, fontsize=9)
    axis.set_xlabel(panel.x_label, fontsize=9)
    axis.set_ylabel(panel.y_label, fontsize=9)
    axis.tick_params(labelsize=8)
    axis.grid(alpha=0.3)
    return drawn


def save_histograms(path: Path, title: str, groups: Mapping[str, Mapping[str, NDArray]]) -> None:
    """A panel per group, its channels over each other."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(-(-len(groups) // 2), 2, squeeze=False).ravel()
    for axis, (name, channels) in zip(axes, groups.items(), strict=False):
        for label, values in channels.items():
            low, high = np.percentile(values, _SHOWN)
            axis.hist(values.ravel(), bins=_BINS, range=(low, max(high, low + 1e-9)), histtype="step", label=label)
        axis.set_title(name, fontsize=9)
        axis.legend(fontsize=7)
    _save(path, figure)


def save_bars(path: Path, title: str, quality: tuple[Sequence[int], Sequence[float]], bits: Sequence[float]) -> None:
    """Quality against k, and the bits of each component."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    figure.suptitle(title, fontsize=10)
    left, right = figure.subplots(1, 2)
    left.plot(*quality, marker="o", markersize=3)
    left.set_xscale("log")
    left.set_xlabel("k")
    left.set_ylabel("dB to the raw render")
    left.grid(alpha=0.3)
    right.bar(range(1, len(bits) + 1), bits)
    right.set_xlabel("component")
    right.set_ylabel("bits per Gaussian")
    _save(path, figure)


def _save(path: Path, figure: Figure) -> None:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
