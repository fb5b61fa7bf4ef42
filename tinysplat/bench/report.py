"""The report folder: `report.md` with its plots, and `report.json`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tinysplat_runtime.system.files import StrPath, atomic_path

from .agreement import REPORT_JSON, Agreement
from .goals import goal_lines
from .growth import Fit
from .plots import plot_growth, plot_overview, plot_stage
from .published import PUBLISHED
from .timing import Row
from .views import VIEWS, Column, Front, View, decibels, kilobytes, megabytes, seconds

REPORT_MD = "report.md"


@dataclass(frozen=True)
class Report:
    """All that a run found.

    Attributes:
        plan: `quick` or `full`.
        machine: of `machine.describe_machine`, when the run began.
        rows: in the order they were measured.
        section_seconds: how long each section took.
        left_out: what was not measured, one line each.
        load_after: load average when the run ended, or None.
        agreement: with an earlier report, if one was named.
    """

    plan: str
    machine: Mapping[str, Any]
    rows: Sequence[Row]
    section_seconds: Mapping[str, float]
    left_out: Sequence[str] = ()
    load_after: Sequence[float] | None = None
    agreement: Agreement | None = None
    notes: Sequence[str] = field(default_factory=tuple)

    def to_json(self) -> dict[str, Any]:
        """A JSON-ready object; infinite figures are the string "inf"."""
        return {
            "plan": self.plan,
            "machine": dict(self.machine),
            "load_after": self.load_after,
            "section_seconds": {name: round(value, 1) for name, value in self.section_seconds.items()},
            "left_out": list(self.left_out),
            "notes": list(self.notes),
            "growth": growth_fits(self.rows),
            "rows": [finite_json(row.to_json()) for row in self.rows],
        }


def finite_json(value: Any) -> Any:
    """The same object with "inf" in place of infinities, which JSON cannot hold."""
    if isinstance(value, Mapping):
        return {key: finite_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite_json(item) for item in value]
    return "inf" if isinstance(value, float) and math.isinf(value) else value


def write_report(folder: StrPath, report: Report) -> Path:
    """Write the folder's files, making it if need be; returns the path of report.md."""
    root = Path(folder)
    root.mkdir(parents=True, exist_ok=True)
    plots = _write_plots(root, report.rows)
    with atomic_path(root / REPORT_JSON) as path:
        path.write_text(json.dumps(report.to_json(), indent=1, allow_nan=False) + "\n", "utf-8")
    with atomic_path(root / REPORT_MD) as path:
        path.write_text("\n".join(_lines(report, plots)) + "\n", "utf-8")
    return root / REPORT_MD


def _write_plots(root: Path, rows: Sequence[Row]) -> dict[str, str]:
    """Relative path of each plot by stage; "overview" and "growth" are stages here."""
    plots = {}

    def add(name: str) -> Path:
        plots[name] = f"plots/{name.replace(' ', '_')}.png"
        return root / plots[name]

    if any(row.seconds for row in rows):
        plot_overview(add("overview"), rows)
    for stage, view in VIEWS.items():
        shown = [
            r for r in rows if r.stage == stage and r.seconds and math.isfinite(r.figures.get(view.y or "", math.nan))
        ]
        if shown:
            plot_stage(add(stage), stage, shown)
    if any(row.stage.startswith("growth ") and row.stage != "growth plane" for row in rows):
        plot_growth(add("growth"), rows)
    return {name: path for name, path in plots.items() if (root / path).is_file()}


def _lines(report: Report, plots: Mapping[str, str]) -> Iterator[str]:
    yield "# Error against run time"
    yield ""
    yield f"`tinysplat bench`, {report.plan} form. {_machine_text(report)}"
    yield ""
    yield (
        "Seconds are medians over interleaved rounds, quartiles in brackets; CPU seconds are those of all threads."
        " ● marks the Pareto front: no other row of the table is at least as good in seconds and every figure that"
        " counts, and better in one. KB are 1000 bytes."
    )
    yield from _left_out(report)
    if "overview" in plots:
        yield from ("", f"![overview]({plots['overview']})")
    yield from goal_lines(report.rows)
    for stage, view in VIEWS.items():
        rows = [row for row in report.rows if row.stage == stage]
        if rows:
            yield from _stage_lines(view, rows, plots.get(stage))
    yield from _peer_lines(report.rows)
    yield from _growth_lines(report.rows, plots.get("growth"))
    if report.agreement is not None:
        yield from ("", "## Against the earlier run", "", *report.agreement.lines())
    yield from ("", "## How long it took", "")
    yield ", ".join(f"{name} {value:.0f} s" for name, value in report.section_seconds.items()) + "."


def _machine_text(report: Report) -> str:
    m = report.machine
    memory = f", {m['memory_bytes'] / 1e9:.0f} GB" if m.get("memory_bytes") else ""
    versions = ", ".join(f"{name} {version}" for name, version in m["packages"].items())
    commit = f" at {m['commit']}" if m.get("commit") else ""
    load = ""
    if m.get("load_average"):
        after = f", {report.load_after[0]:.1f} at its end" if report.load_after else ""
        load = f" Load average {m['load_average'][0]:.1f} at the start{after}: anything above"
        load += f" {m['cores_available']} is work of others, which lengthens wall-clock times more than CPU seconds."
    return (
        f"{m['time']}, {m['processor']} ({', '.join(m['vector_extensions']) or 'no vector extensions known'}),"
        f" {m['cores_available']} of {m['cores_of_machine']} cores{memory}, {m['system']}, Python {m['python']},"
        f" tinysplat {m['tinysplat']}{commit}; {versions}.{load}"
    )


def _left_out(report: Report) -> Iterator[str]:
    if report.left_out:
        yield from ("", f"**Left out: {len(report.left_out)}**", "", *(f"- {line}" for line in report.left_out))
    if report.notes:
        yield from ("", *(f"- {line}" for line in report.notes))


def _stage_lines(view: View, rows: Sequence[Row], plot: str | None) -> Iterator[str]:
    yield from ("", f"## {view.title}", "", view.text)
    for case in dict.fromkeys(row.case for row in rows):
        members = [row for row in rows if row.case == case]
        front = Front.of(view, members)
        columns = [c for c in view.columns if any(c.key in row.figures for row in members)]
        has_ratio = any(row.ratio for row in members)
        heads = ["", "", "seconds", "CPU s", "threads"]
        if has_ratio:
            name = next(row.baseline[0] for row in members if row.baseline).removesuffix(" alone")
            heads.append(f"× {name.removeprefix('lib')}")
        yield from ("", f"**{case}**", "", *_table([*heads, *(c.heading for c in columns)]))
        for row in members:
            mark = "●" if row.variant in front.members and front.is_meaningful else ""
            yield _row_line(row, mark, has_ratio, columns)
    if plot:
        yield from ("", f"![{view.title}]({plot})")


def _table(heads: Sequence[str]) -> Iterator[str]:
    yield f"| {' | '.join(heads)} |"
    yield f"|{'|'.join(['---'] * 2 + ['--:'] * (len(heads) - 2))}|"


def _row_line(row: Row, mark: str, has_ratio: bool, columns: Sequence[Column]) -> str:
    if row.seconds is None:
        return f"| {row.variant} | | {row.note} |"
    cells = [row.variant, mark, _spread(row), seconds(row.seconds.cpu), str(row.threads)]
    if has_ratio:
        cells.append(f"{row.ratio:.2f} ({row.cpu_ratio:.2f})" if row.ratio and row.cpu_ratio else "–")
    cells += [c.write(row.figures[c.key]) if c.key in row.figures else "–" for c in columns]
    return f"| {' | '.join(cells)} |"


def _spread(row: Row) -> str:
    assert row.seconds is not None
    s = row.seconds
    return f"{seconds(s.median)} ({seconds(s.low)}–{seconds(s.high)})" if s.rounds > 1 else seconds(s.median)


def _peer_lines(rows: Sequence[Row]) -> Iterator[str]:
    encodes = [row for row in rows if row.stage == "peers encode"]
    if not encodes:
        return
    decodes = {(row.case, row.variant): row for row in rows if row.stage == "peers decode"}
    yield from ("", "## Peers", "")
    yield "The same Gaussians in other formats, in the same run. dB to raw: against pictures of the raw Gaussians."
    heads = ["", "tool", "KB", "encode", "decode", "dB to raw", "dB lost to photo", ""]
    for case in dict.fromkeys(row.case for row in encodes):
        yield from ("", f"**{case}**", "", *_table(heads))
        for row in (row for row in encodes if row.case == case):
            tool = str(row.settings["tool"])
            if row.seconds is None:
                yield f"| {row.variant} | {tool} | | | | | | {row.note} |"
                continue
            decode = decodes[case, row.variant].seconds
            lost = decibels(row.figures["db_lost"]) if "db_lost" in row.figures else "–"
            cells = [
                row.variant, tool, kilobytes(row.figures["bytes"]), seconds(row.seconds.median),
                seconds(decode.median) if decode else "–", decibels(row.figures["psnr_decoded_raw"]), lost, row.note,
            ]  # fmt: skip
            yield f"| {' | '.join(cells)} |"
    yield from ("", "Published figures, **quoted, not measured here**; other networks, scenes and machines:", "")
    yield from _table(["", "data", "size", "dB to photo", "encode / decode s", "source"])
    for p in PUBLISHED:
        yield f"| {p.method} | {p.data} | {p.size} | {p.psnr} | {p.seconds} | {p.source} |"


COSTS = ("seconds", "CPU seconds", "peak memory")


def growth_fits(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Slope, fixed and per-unit cost of every growing stage on every axis, JSON-ready."""
    fits = []
    groups = dict.fromkeys((row.stage, row.case) for row in rows if row.stage.startswith("growth "))
    for stage, axis in groups:
        members = [r for r in rows if (r.stage, r.case) == (stage, axis) and r.seconds is not None]
        x = [float(r.settings["x"]) for r in members]
        series = {
            "seconds": [r.seconds.median for r in members if r.seconds],
            "CPU seconds": [r.seconds.cpu for r in members if r.seconds],
            "peak memory": [float(r.peak_bytes) for r in members if r.peak_bytes],
        }
        for cost in COSTS:
            y = series[cost]
            if len(y) != len(x) or len(x) < 2:
                continue
            fit = Fit.of(x, y)
            unit = megabytes if cost == "peak memory" else seconds
            fits.append(
                {
                    "stage": stage, "axis": axis, "cost": cost, "slope": round(fit.slope, 3),
                    "fixed": fit.fixed, "per_unit": fit.per_unit,
                    "steps": [round(step, 3) for _, step in fit.steps], "linear_from": fit.linear_from,
                    "sentence": fit.sentence(axis, unit, x[0]),
                }
            )  # fmt: skip
    return fits


def _growth_lines(rows: Sequence[Row], plot: str | None) -> Iterator[str]:
    growing = [row for row in rows if row.stage.startswith("growth ")]
    if not growing:
        return
    yield from ("", "## Growth", "")
    yield (
        "Network-like Gaussians of SH degree 3, the default profile; two views unless views grow. Peak memory is that"
        " of a process of its own while it works, input and libraries included. Slopes are those of log-log lines; 1 is"
        " in proportion. A dotted line on the plot is what proportion to the largest point would be."
    )
    if plot:
        yield from ("", f"![growth]({plot})")
    yield from ("", *_table(["", "axis", "points", "seconds", "peak memory"]))
    for stage, axis in dict.fromkeys((row.stage, row.case) for row in growing):
        members = [row for row in growing if (row.stage, row.case) == (stage, axis)]
        times = ", ".join(seconds(row.seconds.median) for row in members if row.seconds)
        peaks = ", ".join(megabytes(row.peak_bytes) for row in members if row.peak_bytes)
        points = ", ".join(f"{row.settings['x']:,}" for row in members)
        yield f"| {stage.removeprefix('growth ')} | {axis} | {points} | {times} | {peaks} |"
    yield from ("", "| | axis | cost | slope | where it stops being linear |", "|---|---|---|--:|---|")
    for fit in growth_fits(rows):
        name = fit["stage"].removeprefix("growth ")
        yield f"| {name} | {fit['axis']} | {fit['cost']} | {fit['slope']:.2f} | {fit['sentence']} |"
    yield from _growth_reasons(growing)


def _growth_reasons(rows: Sequence[Row]) -> Iterator[str]:
    planes = [(row.variant, row.seconds.cpu) for row in rows if row.stage == "growth plane" and row.seconds is not None]
    if not planes:
        return
    (small, small_cpu), (large, large_cpu) = planes[0], planes[-1]
    yield ""
    yield (
        f"Why encoding starts slower than in proportion: libx265 is opened anew for every plane, and a {small}"
        f" plane costs {seconds(small_cpu)} of CPU where a {large} one costs {seconds(large_cpu)}; a file of"
        " two views has about 36 planes. Memory starts at the interpreter, numpy, onnxruntime and av, whatever"
        " the input. The network `sweep` compares a view with one other where there are two, and with two"
        " others where there are more, so its cost per view doubles once, at the third view. Rendering costs"
        " per Gaussian (projection, sorting) and per pixel (compositing), so each axis alone grows slower than"
        " in proportion until its own share dominates."
    )
