"""How timed rows are shown: which columns their table has, what counts as an error, and what their plot shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..rows import Row, grouped
from .plots import Curve, Panel, save_grid
from .tables import ABSENT, decibels, duration, format_table, kilobytes, megabytes


@dataclass(frozen=True)
class Column:
    """A figure in a table: its key in `Row.figures`, its heading, and how it is written."""

    key: str
    heading: str
    write: Callable[[float], str]


@dataclass(frozen=True)
class View:
    """A place in the report.

    Attributes:
        study: whose rows.
        title: of the section.
        text: what is measured and what the columns mean.
        columns: of the table, behind the seconds.
        costs: figures that are better when lower, beside the seconds; they decide the Pareto front.
        gains: figures that are better when higher.
        y: figure on the plot's vertical axis, or None for no plot.
        y_label: its name.
        is_log: whether that axis is logarithmic.
        group: setting whose values are joined by a line, or None.
    """

    study: str
    title: str
    text: str
    columns: Sequence[Column] = ()
    costs: Sequence[str] = ()
    gains: Sequence[str] = ()
    y: str | None = None
    y_label: str = ""
    is_log: bool = False
    group: str | None = None

    def section(self, rows: Sequence[Row]) -> str:
        """Title, text and a table per subject; empty where there are no rows of the study."""
        rows = [row for row in rows if row.study == self.study]
        if not rows:
            return ""
        tables = [f"**{subject}**\n\n{self.table(members)}" for (subject,), members in grouped(rows, "subject").items()]
        return "\n\n".join([f"### {self.title}", self.text, *tables])

    def table(self, rows: Sequence[Row]) -> str:
        """Rows of one subject; ● marks those that no other beats in everything."""
        best = front(self, rows)
        columns = [column for column in self.columns if any(column.key in row.figures for row in rows)]
        baseline = next((row.setting["baseline"] for row in rows if "baseline" in row.setting), None)
        has_peaks = any("peak_bytes" in row.costs for row in rows)
        heads = ["", "", "seconds", "CPU s", "threads", *([f"× {baseline}"] if baseline else []),
                 *(column.heading for column in columns), *(["peak"] if has_peaks else [])]  # fmt: skip
        lines = []
        for row in rows:
            if row.seconds is None:
                lines.append([row.way, "", row.note, *[""] * (len(heads) - 3)])
                continue
            cells = [row.way, "●" if row.way in best else "", spread(row), duration(row.costs["cpu"]),
                     str(row.setting.get("threads", ""))]  # fmt: skip
            if baseline:
                has_ratio = "ratio" in row.costs
                cells.append(f"{row.costs['ratio']:.2f} ({row.costs['cpu_ratio']:.2f})" if has_ratio else ABSENT)
            cells += [c.write(row.figures[c.key]) if c.key in row.figures else ABSENT for c in columns]
            cells += [megabytes(row.costs["peak_bytes"]) if "peak_bytes" in row.costs else ABSENT] if has_peaks else []
            lines.append(cells)
        return format_table(heads, lines)

    def plot(self, path: Path, rows: Sequence[Row]) -> bool:
        """The view's figure against seconds, a panel per subject; whether there was anything to show."""
        panels = list(self.panels(rows))
        if panels:
            save_grid(path, self.title, [panels])
        return bool(panels)

    def panels(self, rows: Sequence[Row]) -> Iterator[Panel]:
        """A panel per subject."""
        key = self.y or ""
        shown = [row for row in rows if row.study == self.study and row.seconds is not None
                 and math.isfinite(row.figures.get(key, math.nan))]  # fmt: skip
        for (subject,), members in grouped(shown, "subject").items():
            curves = []
            groups = grouped(members, self.group) if self.group else {("",): members}
            for (name,), group in groups.items():
                points = [(row.seconds or 0.0, float(row.figures[key])) for row in group]
                is_named = not self.group and len(members) <= 12
                labels = [row.way for row in group] if is_named else []
                curves.append(Curve(str(name), points, bool(self.group), labels))
            yield Panel(subject, "seconds, median", self.y_label, curves, log="xy" if self.is_log else "x")


def front(view: View, rows: Sequence[Row]) -> set[str]:
    """Ways of one subject that no other beats in seconds and every figure that counts; none where nothing else counts
    or there was no choice. Rows that lack a figure that counts are left aside.
    """
    keys = [key for key in (*view.costs, *view.gains) if any(key in row.figures for row in rows)]
    vectors = {
        row.way: (row.seconds, *(-row.figures[k] if k in view.gains else row.figures[k] for k in keys))
        for row in rows
        if row.seconds is not None and all(key in row.figures for key in keys)
    }
    if not keys or len(rows) < 2:
        return set()
    return {
        name
        for name, vector in vectors.items()
        if not any(other != vector and all(o <= v for o, v in zip(other, vector, strict=True))
                   for other in vectors.values())
    }  # fmt: skip


def spread(row: Row) -> str:
    """Median seconds, with quartiles where there were rounds."""
    costs = row.costs
    if costs.get("rounds", 1) < 2:
        return duration(costs["seconds"])
    return f"{duration(costs['seconds'])} ({duration(costs['low'])}–{duration(costs['high'])})"


BYTES = Column("bytes", "KB", kilobytes)
TO_RAW = Column("psnr_decoded_raw", "dB to raw", decibels)
LOST = Column("db_lost", "dB lost to photo", decibels)
TO_PHOTO = Column("psnr", "dB to photo", decibels)
