"""Rows to pages: the report of a run, the goals it meets, its agreement with an earlier one, and the marked places of
README and docs.

A place is filled from committed rows and stands between two marks:

    <!-- measured 2026-11-22/rows.jsonl: encode -->
    …
    <!-- end -->

The file lies in `benchmarks/reports/`; the words behind the colon name a table of a study (`Study.tables`), and behind
it, if need be, what chooses rows: `table where subject=…; way=…`. Marks may stand within a line; those behind a
backtick are talked about. A plot is drawn from the newest report there that has rows for it:

    <!-- plotted overview -->
    ![Error against run time](docs/overview.png)
    …
    <!-- end -->
"""

from __future__ import annotations

import os
import re
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import write_atomically

from ..curves import bytes_at
from ..rows import ROWS, Row, read_rows
from ..studies import STUDIES, find_study
from .plots import Chart, save_grid
from .tables import duration, format_table, megabytes, percent

REPORT_MD = "report.md"
REPORTS = Path("benchmarks", "reports")
RUN = "run"
"""`Row.study` of the row that says what a run was made on."""

_MARK = re.compile(
    r"(?<!`)(?P<open><!-- measured (?P<file>[^\s:]+): (?P<table>[^>]+?) -->)(?P<text>.*?)(?P<close><!-- end -->)",
    re.DOTALL,
)


_PLOT = re.compile(
    r"(?<!`)<!-- plotted (?P<plot>[^>]+?) -->\n(?P<image>!\[[^]]*\]\((?P<path>[^)]+)\)).*?<!-- end -->", re.DOTALL
)
OVERVIEW = "overview"
"""The plot of all views that have one: error against run time, the first subject of each, six at most."""


def write_report(folder: Path, rows: Sequence[Row], left_out: Sequence[str] = (), before: Sequence[Row] = ()) -> Path:
    """Write report.md and its plots beside the rows; returns its path."""
    lines = ["# Measured", "", *_machine(rows), *(f"- {line}" for line in left_out), ""]
    goals = goal_table(rows)
    lines += ["## Goals", "", "For two cores to ourselves, without a GPU.", "", goals, ""] if goals else []
    if _draw_overview(folder / "plots" / f"{OVERVIEW}.png", rows):
        lines += [f"![Error against run time](plots/{OVERVIEW}.png)", ""]
    for name in STUDIES:
        study = find_study(name)
        tables = [text for table in study.tables.values() if (text := table(rows))]
        if not tables:
            continue
        lines += [f"## {study.title}", ""]
        for text in tables:
            lines += [text, ""]
        for plot, draw in study.plots.items():
            path = folder / "plots" / f"{plot.replace(' ', '_')}.png"
            if draw(path, rows):
                lines += [f"![{study.title}](plots/{path.name})", ""]
    if before:
        lines += ["## Against the earlier run", "", *agreement(before, rows), ""]
    write_atomically(folder / REPORT_MD, "\n".join(lines).encode())
    return folder / REPORT_MD


def _draw_overview(path: Path, rows: Sequence[Row]) -> bool:
    charts = [plot for name in STUDIES for plot in find_study(name).plots.values() if isinstance(plot, Chart)]
    panels = [
        replace(chart.panels(rows)[0], title=chart.title)
        for chart in charts
        if chart.x.key == "seconds" and chart.curve and chart.panels(rows)  # labels of single points would overlap
    ]
    if panels:
        save_grid(path, "Error against run time", [panels[i : i + 3] for i in range(0, len(panels), 3)][:2])
    return bool(panels)


def agreement(before: Sequence[Row], now: Sequence[Row]) -> list[str]:
    """Whether two runs agree, one fact a line: figures that must be identical, and times that should be alike."""
    old = {row.key: row for row in before if row.study != RUN}
    pairs = [(old[row.key], row) for row in now if row.key in old]
    differences, count = [], 0
    for a, b in pairs:
        names = sorted({*a.figures, *b.figures})
        count += len(names)
        where = f"{b.study} | {b.subject} | {b.way}"
        differences += [
            f"  {where}: {name} was {a.figures.get(name)}, is {b.figures.get(name)}"
            for name in names
            if a.figures.get(name) != b.figures.get(name)
        ]
    lines = [
        f"{len(pairs)} rows are in both; of {count} figures that do not depend on time {count - len(differences)} are"
        f" identical and {len(differences)} differ.",
        *differences[:20],
    ]
    for cost, label in (("seconds", "Seconds"), ("cpu", "CPU seconds")):
        ratios = {f"{b.study} | {b.subject} | {b.way}": b.costs[cost] / a.costs[cost]
                  for a, b in pairs if a.costs.get(cost) and cost in b.costs}  # fmt: skip
        if len(ratios) > 1:
            low, middle, high = statistics.quantiles(ratios.values(), n=4, method="inclusive")
            lines.append(f"{label} now over before: median {middle:.2f}, quartiles {low:.2f} to {high:.2f}.")
            slowest = sorted(ratios.items(), key=lambda item: -item[1])[:5]
            lines += [f"  {name}: {ratio:.2f} × the {label} of before" for name, ratio in slowest if ratio > 1.25]
    return lines


def _machine(rows: Sequence[Row]) -> Iterator[str]:
    """What the rows were made on, of every run that made some."""
    for row in rows:
        if row.study != RUN:
            continue
        m: Mapping[str, Any] = row.figures
        memory = f", {m['memory_bytes'] / 1e9:.0f} GB" if m.get("memory_bytes") else ""
        commit = f" at {m['commit']}" if m.get("commit") else ""
        yield (
            f"`tinysplat bench {row.way}`: {row.subject}, {m['cpu']} ({', '.join(m['vector_extensions'])}),"
            f" {m['cores']} of {m['cores_of_machine']} cores{memory}, load {m['load_average']} at the start,"
            f" Python {m['python']}, tinysplat {m['tinysplat']}{commit}, numpy {m['numpy']}, onnxruntime"
            f" {m['onnxruntime']}, av {m['av']}; {row.costs['seconds'] / 60:.1f} minutes.\n"
        )
    yield (
        "Seconds are medians over interleaved rounds, quartiles in brackets; CPU seconds are those of all threads. ●"
        " marks what no other way of a table beats in seconds and every figure that counts. KB are 1000 bytes."
    )


# ---- marked places ------------------------------------------------------------------------------------------------


def pages(root: Path) -> list[Path]:
    """Pages that may have marks."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def filled(text: str, root: Path, page: str = "") -> str:
    """A page with every marked place filled anew from committed rows.

    Raises:
        InputError: a mark names rows or a table that there are not, or nothing is there for it.
    """

    def fill(match: re.Match[str]) -> str:
        found = _marked(root / REPORTS / match["file"], match["table"], page)
        end = "\n" if match["text"].startswith("\n") or not match["text"] else ""
        return f"{match['open']}{end}{found}{end}{match['close']}"

    return _MARK.sub(fill, text)


def fill_pages(root: Path) -> list[Path]:
    """Fill all pages; those that changed."""
    changed = []
    for path in pages(root):
        text = path.read_text("utf-8")
        new = _PLOT.sub(partial(_plotted, root=root, page=path), filled(text, root, path.name))
        if new != text:
            write_atomically(path, new.encode())
            changed.append(path)
    return changed


def _plotted(match: re.Match[str], root: Path, page: Path) -> str:
    """A plot drawn anew beside its page, and the line that says which report it is of; as it was where none has it."""
    plots = {name: plot for study in map(find_study, STUDIES) for name, plot in study.plots.items()}
    draw = _draw_overview if match["plot"] == OVERVIEW else plots.get(match["plot"])
    if draw is None:
        raise InputError(f"no study has a plot '{match['plot']}'", where=page.name)
    for path in sorted((root / REPORTS).glob(f"*/{ROWS}"), reverse=True):
        if draw(page.parent / match["path"], read_rows(path)):
            report = os.path.relpath(path.with_name(REPORT_MD), page.parent)
            mark = f"<!-- plotted {match['plot']} -->"
            return f"{mark}\n{match['image']}\n\n*From [{path.parent.name}]({report}).*\n<!-- end -->"
    return match[0]


def _marked(path: Path, words: str, page: str) -> str:
    name, _, condition = words.partition(" where ")
    wanted = dict(part.strip().split("=", 1) for part in condition.split(";") if part.strip())
    rows = read_rows(path)
    for key, value in wanted.items():
        rows = [row for row in rows if str(getattr(row, key, row.setting.get(key))) == value]
    for study in map(find_study, STUDIES):
        if name in study.tables:
            text = study.tables[name](rows)
            if not text:
                raise InputError(f"{path.name} has no rows for '{words}'", where=page)
            return text
    raise InputError(f"no study has a table '{name}'", where=page)


# ---- goals --------------------------------------------------------------------------------------------------------

EQUAL_DB = (38.0, 39.0, 40.0, 41.0)
"""dB against the raw render at which sizes are compared."""

Value = Callable[[Sequence[Row]], float | None]


@dataclass(frozen=True)
class Goal:
    """A bound that a figure should stay below.

    Attributes:
        name: what is bounded.
        bound: at most.
        write: how both are written.
        value: finds the figure in a run's rows; None where it was not measured.
    """

    name: str
    bound: float
    write: Callable[[float], str]
    value: Value


def cost(study: str, way: str, name: str = "seconds", subject: str = "") -> Value:
    """A cost of the first row of a study whose way begins, and whose subject holds, so."""

    def value(rows: Sequence[Row]) -> float | None:
        found = (row.costs[name] for row in rows if row.study == study and row.way.startswith(way)
                 and subject in row.subject and name in row.costs)  # fmt: skip
        return next(found, None)

    return value


def size_at_equal_db(rows: Sequence[Row]) -> float | None:
    """Geometric mean over `EQUAL_DB` of the default profile's bytes by `paper`'s, on the first subject."""
    encodes = [row for row in rows if row.study == "encode"]
    curves = [
        [(row.figures["bytes"], row.figures["psnr_decoded_raw"]) for row in encodes
         if row.subject == encodes[0].subject and row.setting["profile"] == profile]
        for profile in ("paper", DEFAULT_PROFILE)
    ]  # fmt: skip
    pairs = [[bytes_at(curve, db) for curve in curves] for db in EQUAL_DB]
    ratios = [ours / paper for paper, ours in pairs if paper is not None and ours is not None]
    return statistics.geometric_mean(ratios) if ratios else None


def _times(value: float) -> str:
    return f"{value:.2f} ×"


_CODED, _DRAWN = "2×256×256", "131,072 Gaussians at 256×256"

GOALS: tuple[Goal, ...] = (
    Goal("decoding 2×256×256, by libavcodec alone on the same streams (1 thread, CPU)", 1.5, _times,
         cost("decode", f"{DEFAULT_PROFILE} qp 0, 1 thread", "cpu_ratio", _CODED)),
    Goal("encoding 2×256×256, by libx265 alone on the same planes (CPU)", 1.2, _times,
         cost("encode", f"{DEFAULT_PROFILE} qp 0", "cpu_ratio", _CODED)),
    Goal("encoding 2×256×256", 1.0, duration, cost("encode", f"{DEFAULT_PROFILE} qp 0", subject=_CODED)),
    Goal("a frame of 131,072 Gaussians at 256×256, 1 thread", 0.05, duration,
         cost("rasteriser", "numpy, 1 thread", subject=_DRAWN)),
    Goal("the same compiled, 2 threads", 1 / 60, duration,
         cost("rasteriser", "compiled, 2 threads", subject=_DRAWN)),
    Goal("size at equal dB to raw (38 to 41), by `paper`'s", 0.45, percent, size_at_equal_db),
    Goal("`tinysplat decode` from a cold start", 0.6, duration, cost("cold start", "tinysplat decode")),
    Goal("peak memory of decoding 2×256×256", 250e6, megabytes,
         cost("decode", f"{DEFAULT_PROFILE} qp 0, 1 thread", "peak_bytes", _CODED)),
)  # fmt: skip


def goal_table(rows: Sequence[Row]) -> str:
    """Goals that were measured; empty where none was."""
    found = [(goal, goal.value(rows)) for goal in GOALS]
    lines = [
        [goal.name, goal.write(value), goal.write(goal.bound), "met" if value <= goal.bound else "not met"]
        for goal, value in found
        if value is not None
    ]
    return format_table(["", "found", "at most", ""], lines) if lines else ""
