"""The one plotter: panels of curves, drawn with matplotlib without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tinysplat_runtime.system.files import atomic_path

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
    """

    title: str
    x_label: str
    y_label: str
    curves: Mapping[str, Points]


def save_panels(path: Path, panels: Sequence[Panel]) -> None:
    """Panels beside one another; the legend stands outside."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(name for panel in panels for name in panel.curves))
    figure = Figure(figsize=(3.9 * len(panels) + 1.9, 3.6), layout="constrained")
    drawn: dict[str, Artist] = {}
    for number, panel in enumerate(panels, start=1):
        drawn |= _draw_panel(figure.add_subplot(1, len(panels), number), panel, names)
    figure.legend([drawn[name] for name in names], names, loc="outside right center", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=_DPI, metadata={"Software": None})


def _draw_panel(axes: Axes, panel: Panel, names: Sequence[str]) -> dict[str, Artist]:
    """What stands for each curve in a legend."""
    drawn: dict[str, Artist] = {}
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
