"""The one plotter: rows as charts and panels of curves, drawn with matplotlib without a display."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tinysplat_runtime.system.files import atomic_path

from ..rows import Row, grouped, of_study

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_COLOURS = ("#1b6ca8", "#d1495b", "#2a9d54", "#8f5bb5", "#c7861f", "#4d4d4d", "#12a0a8", "#a33d8f", "#7a6a00")
_MARKERS = "osD^vPX*d"
_DPI = 100

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Panel:
    """Curves that share axes, of which x is logarithmic.

    Attributes:
        title: above it.
        x_label, y_label: of the axes.
        curves: points (x, y), finite and x above 0, joined in their order; one name has one colour and mark throughout
            a picture.
        level: a dashed line across, or None.
    """

    title: str
    x_label: str
    y_label: str
    curves: Mapping[str, Points]
    level: float | None = None


@dataclass(frozen=True)
class Axis:
    """What an axis shows of rows: a figure times `unit`; none above `most`."""

    key: str
    label: str
    unit: float = 1.0
    most: float = math.inf

    def of(self, rows: Sequence[Row]) -> float | None:
        """Mean over rows, or None where it is finite in none."""
        values = [row.figures.get(self.key) for row in rows]
        known = [value for value in values if value is not None and math.isfinite(value)]
        found = [self.unit * value for value in known if value <= self.most]
        return statistics.fmean(found) if found else None


@dataclass(frozen=True)
class Chart:
    """A study's rows as curves: one per way, with a point per Q_g at the mean of its rows.

    Attributes:
        study: whose rows.
        title: of the picture.
        x, y: what is drawn against what.
        panel: attribute or setting that has a panel per value; empty for one panel.
    """

    study: str
    title: str
    x: Axis
    y: Axis
    panel: str = ""

    def __call__(self, path: Path, rows: Sequence[Row]) -> bool:
        """Draw a PNG file; False where no row is of the study."""
        panels = self.panels(rows)
        if panels:
            save_grid(path, self.title, [panels])
        return bool(panels)

    def panels(self, rows: Sequence[Row], level: float | None = None) -> list[Panel]:
        """A panel per value of `panel`, those without points left out."""
        drawn = []
        for name, members in _parts(of_study(rows, self.study), self.panel).items():
            curves = {
                label: points for label, group in _parts(members, "way").items() if (points := self._points(group))
            }
            if curves:
                drawn.append(Panel(name, self.x.label, self.y.label, curves, level))
        return drawn

    def _points(self, rows: Sequence[Row]) -> Points:
        points = [(self.x.of(group), self.y.of(group)) for group in _parts(rows, "qp").values()]
        return sorted((x, y) for x, y in points if x is not None and y is not None)


def _parts(rows: Sequence[Row], name: str) -> dict[str, list[Row]]:
    return {str(value): group for (value,), group in grouped(rows, name).items()} if name else {"": list(rows)}


def save_grid(path: Path, title: str, rows: Sequence[Sequence[Panel]]) -> None:
    """Panels in rows; the legend stands outside."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(name for row in rows for panel in row for name in panel.curves))
    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(3.9 * columns + 1.9, 3.3 * len(rows) + 0.3), layout="constrained")
    figure.suptitle(title, fontsize=10)
    drawn: dict[str, Artist] = {}
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            drawn |= _draw_panel(figure.add_subplot(len(rows), columns, i * columns + j + 1), panel, names)
    figure.legend([drawn[name] for name in names], names, loc="outside right center", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=_DPI, metadata={"Software": None})


def _draw_panel(axes: Axes, panel: Panel, names: Sequence[str]) -> dict[str, Artist]:
    """What stands for each curve in a legend."""
    drawn: dict[str, Artist] = {}
    if panel.level is not None:
        axes.axhline(panel.level, color="black", lw=0.8, ls="--")
    for name, points in panel.curves.items():
        n, (x, y) = names.index(name), zip(*points, strict=True)
        colour, marker = _COLOURS[n % len(_COLOURS)], _MARKERS[n % len(_MARKERS)]
        (drawn[name],) = axes.plot(x, y, color=colour, marker=marker, markersize=4, lw=1.2)
    _logarithmic(axes)
    axes.margins(0.08, 0.1)
    axes.set_title(panel.title, fontsize=9)
    axes.set_xlabel(panel.x_label, fontsize=9)
    axes.set_ylabel(panel.y_label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.3)
    return drawn


def _logarithmic(axes: Axes) -> None:
    """A log scale of x whose ticks are plain numbers; 1, 2 and 5 of every decade where there are few decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    low, high = axes.xaxis.get_data_interval()
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 1e3 * max(low, 1e-300) else (1,)))
    axes.xaxis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value:g}" if value < 1e4 else f"{value / 1000:g}k")
    )
    axes.xaxis.set_minor_formatter(NullFormatter())
