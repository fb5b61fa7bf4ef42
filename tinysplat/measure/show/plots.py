"""The one plotter: panels of curves, drawn with matplotlib without a display."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tinysplat_runtime.system.files import atomic_path

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Panel:
    """Curves that share axes, of which x is logarithmic.

    Attributes:
        title: above it.
        x_label, y_label: of the axes.
        curves: points (x, y), finite and x above 0, joined in their order; one name has one colour throughout.
    """

    title: str
    x_label: str
    y_label: str
    curves: Mapping[str, Points]


def save_panels(path: Path, panels: Sequence[Panel]) -> None:
    """Panels beside one another; the legend stands outside."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    figure = Figure(figsize=(3.9 * len(panels) + 1.9, 3.6), layout="constrained")
    lines: dict[str, Any] = {}
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for name, points in panel.curves.items():
            colour = lines[name].get_color() if name in lines else f"C{len(lines)}"
            (lines[name],) = axes.semilogx(*zip(*points, strict=True), "o-", color=colour)
        axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.margins(0.1)
        axes.grid(alpha=0.3)
    figure.legend(lines.values(), lines.keys(), loc="outside right center")
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": None})
