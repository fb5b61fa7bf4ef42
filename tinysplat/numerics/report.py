"""Tables and plots of docs/NUMERICS.md: written between the marks that the page has for them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from tinysplat.bench.timing import Row

from .pictures import QuantiserRow
from .reduction import FloorRow
from .rows import NumericRow, show

WAYS = {"float32": "#d1495b", "ours": "#1b6ca8", "float64": "#2a9d54"}

_EXACT = 1e-17
"""Where errors of 0 stand on a logarithmic axis."""


def put_table(page: Path, name: str, markdown: str) -> None:
    """Replace what stands between `<!-- NAME -->` and `<!-- end -->`; ValueError if the page has no such place."""
    text = page.read_text("utf-8")
    pattern = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
    new, count = pattern.subn(lambda m: f"{m[1]}{markdown}\n{m[2]}", text)
    if count != 1:
        raise ValueError(f"{page} has {count} places for the table {name}")
    page.write_text(new, "utf-8")


def floor_table(rows: Sequence[FloorRow]) -> str:
    """The floors of VABR's weighting."""
    lines = [
        "| cameras | weighting | least λ | condition of Δ | noise in coefficients | in colour seen | 10° beside"
        " | float32 round trip |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        numbers = (r.least, r.condition, r.amplification, r.seen, r.beside, r.round_trip)
        lines.append(f"| {r.cameras} | {r.weighting} | {' | '.join(map(show, numbers))} |")
    return "\n".join(lines)


def quantiser_table(rows: Sequence[QuantiserRow]) -> str:
    """Planes that strain 12 bits."""
    lines = [
        "| plane | step wanted | step reached | coded as | error of codes, steps | clipped |",
        "|---|---|---|---|---|---|",
    ]
    for r in rows:
        reached = show(r.reached) if r.reached else "–"
        error = show(r.error) if r.reached else f"{show(r.error)} (units)"
        lines.append(f"| {r.case} | {show(r.wanted)} | {reached} | {r.what} | {error} | {r.clipped} of 4096 |")
    return "\n".join(lines)


def speed_table(rows: Sequence[Row]) -> str:
    """Error and CPU time of each transform's variants."""
    lines = ["| transform | float32 | | ours | | float64 | |", "|---|---|---|---|---|---|---|",
             "| | error | CPU ms | error | CPU ms | error | CPU ms |"]  # fmt: skip
    for stage in dict.fromkeys(row.stage for row in rows):
        cells = []
        for way in WAYS:
            row = next(r for r in rows if (r.stage, r.variant) == (stage, way))
            cells += [show(row.figures["error"]), f"{row.seconds.cpu * 1000:.1f}" if row.seconds else "–"]
        lines.append(f"| {stage} | {' | '.join(cells)} |")
    return "\n".join(lines)


def plot_speed(path: Path, rows: Sequence[Row]) -> None:
    """Error against CPU time, one panel per transform."""
    stages = list(dict.fromkeys(row.stage for row in rows))
    figure = Figure(figsize=(10.5, 6.2), layout="constrained")
    FigureCanvasAgg(figure)
    for i, stage in enumerate(stages):
        axes = figure.add_subplot(2, (len(stages) + 1) // 2, i + 1)
        times = []
        for way, colour in WAYS.items():
            row = next(r for r in rows if (r.stage, r.variant) == (stage, way))
            if row.seconds is not None:
                times.append(row.seconds.cpu * 1000)
                axes.scatter(times[-1], max(row.figures["error"], _EXACT), color=colour, label=way, s=42)
        axes.set(xscale="log", yscale="log", title=stage, ylim=(_EXACT / 3, 1))
        axes.set_xlim(min(times) / 1.6, max(times) * 1.6)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3)
        if i == 0:
            figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=len(WAYS))
    figure.supxlabel("CPU milliseconds, 2×256×256 Gaussians (lower left is better)")
    figure.supylabel("error (0 drawn at 1e-17)")
    figure.savefig(path, dpi=90)


def plot_errors(path: Path, rows: Sequence[NumericRow]) -> None:
    """Every case's three errors and its bound, one panel per transform."""
    names = list(dict.fromkeys(row.transform for row in rows))
    figure = Figure(figsize=(11, 3.6 * ((len(names) + 1) // 2)), layout="constrained")
    FigureCanvasAgg(figure)
    for i, name in enumerate(names):
        members = [row for row in rows if row.transform == name]
        axes = figure.add_subplot((len(names) + 1) // 2, 2, i + 1)
        at = range(len(members))
        for way, colour in WAYS.items():
            key = {"float32": "plain", "float64": "double"}.get(way, way)
            values = [min(max(float(getattr(row, key)), _EXACT), 10.0) for row in members]
            axes.plot(at, values, "o", color=colour, label=way, markersize=4)
        axes.plot(at, [row.bound for row in members], "_", color="black", label="bound", markersize=9)
        axes.set(yscale="log", title=name, xlabel="case, in the table's order", ylabel="error")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(alpha=0.3)
        if i == 0:
            figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=len(WAYS) + 1)
    figure.savefig(path, dpi=90)
