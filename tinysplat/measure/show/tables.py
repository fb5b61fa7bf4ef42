"""Rows as tables for people and for spreadsheets, and how numbers are written in them.

A `Listing` has a line per group of rows; a `View` shows timed rows: seconds, what they are held against, and which of
them nothing else beats.
"""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..rows import Row, grouped, of_study
from .plots import Axis, Chart

ABSENT = "–"

Cell = Callable[[Sequence[Row]], str]
"""What a table says of a group of rows."""


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table whose columns line up: the first to the left, the others to the right."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]

    def text(line: Sequence[str]) -> str:
        cells = [line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]
        return f"| {' | '.join(cells)} |"

    rule = "|".join(["-" * (widths[0] + 2), *("-" * (w + 1) + ":" for w in widths[1:])])
    return "\n".join([text(lines[0]), f"|{rule}|", *(text(line) for line in lines[1:])])


def within(text: str, width: int) -> str:
    """A text whose tables are no wider: the columns of a wide one follow in further tables, each with the first."""
    blocks = []
    for block in text.split("\n\n"):
        before, table = _before_and_table(block.splitlines())
        blocks.append("\n".join([*before, "\n\n".join(_narrowed(table, width))] if table else before))
    return "\n\n".join(blocks)


def _before_and_table(lines: Sequence[str]) -> tuple[list[str], list[str]]:
    first = next((i for i, line in enumerate(lines) if line.startswith("|")), len(lines))
    return list(lines[:first]), list(lines[first:])


def _narrowed(table: Sequence[str], width: int) -> list[str]:
    header, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in (table[0], *table[2:]))
    widths = [max(map(len, column)) + 3 for column in zip(header, *rows, strict=True)]
    parts: list[list[int]] = [[]]
    for column in range(1, len(header)):
        if parts[-1] and 1 + widths[0] + sum(widths[i] for i in (*parts[-1], column)) > width:
            parts.append([])
        parts[-1].append(column)
    return [
        format_table([header[i] for i in (0, *part)], [[row[i] for i in (0, *part)] for row in rows]) for part in parts
    ]


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """A line per object: nested figures as `seconds.x265` and the like, lists joined by spaces."""
    flat = [dict(_flat("", row)) for row in rows]
    columns = list(dict.fromkeys(name for row in flat for name in row))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return buffer.getvalue()


def number(value: Any, digits: int) -> str:
    """A number with so many digits behind the point, or a dash."""
    if value is None:
        return ABSENT
    return f"{value:.{digits}f}" if math.isfinite(value) else "∞"


def decibels(value: float | None) -> str:
    """dB, two digits; a dash for none."""
    return number(value, 2)


def kilobytes(value: float | None) -> str:
    """Bytes in KB of 1000."""
    if value is None:
        return ABSENT
    return f"{value / 1000:,.1f}" if value < 1e6 else f"{value / 1000:,.0f}"


def megabytes(value: float) -> str:
    """Bytes in MB of 10⁶."""
    return f"{value / 1e6:.0f} MB"


def small(value: float) -> str:
    """An error, two significant digits: 0, 3.1e-08, 120, ∞."""
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞"
    return f"{value:.2g}"


def percent(value: float) -> str:
    """A share."""
    return f"{100 * value:.2f} %"


def whole(value: float) -> str:
    """A count."""
    return f"{value:,.0f}"


def duration(value: float | None) -> str:
    """Seconds in the unit that suits them."""
    if value is None:
        return ABSENT
    if value >= 1:
        return f"{value:.2f} s"
    return f"{1000 * value:.1f} ms" if value >= 1e-3 else f"{1e6 * value:.0f} µs"


def _flat(name: str, value: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}" if name else key, inner)
    else:
        yield name, " ".join(map(str, value)) if isinstance(value, list | tuple) else value


# ---- listings -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Listing:
    """A table of a study's rows.

    Attributes:
        study: whose rows.
        columns: what each line says, by heading; the first one stands to the left.
        by: attributes and settings whose values tell lines apart; empty for a line per row.
        sections: the attribute that has a table per value, under that value; empty for one table.
        text: above the tables.
        wanted: which of the rows are shown.
    """

    study: str
    columns: Mapping[str, Cell]
    by: Sequence[str] = ()
    sections: str = ""
    text: str = ""
    wanted: Callable[[Row], bool] = lambda _: True

    def __call__(self, rows: Sequence[Row]) -> str:
        """Markdown; empty where no row is of the study."""
        rows = list(filter(self.wanted, of_study(rows, self.study)))
        if not rows:
            return ""
        parts = grouped(rows, self.sections) if self.sections else {("",): rows}
        tables = [f"**{name}**\n\n{self.table(part)}" if name else self.table(part) for (name,), part in parts.items()]
        return "\n\n".join([*filter(None, [self.text]), *tables])

    def table(self, rows: Sequence[Row]) -> str:
        """One table of rows, whatever their study."""
        groups = grouped(rows, *self.by).values() if self.by else ([row] for row in rows)
        return format_table(list(self.columns), [[cell(group) for cell in self.columns.values()] for group in groups])


def said(name: str, write: Callable[[Any], str] = str) -> Cell:
    """What a group has in common: an attribute or a setting of its first row."""
    return lambda rows: write(getattr(rows[0], name, rows[0].setting.get(name)))


def mean(name: str, write: Callable[[Any], str], kind: str = "figures") -> Cell:
    """Mean of a figure, or of a cost with `kind` costs, over the rows of a group that have it; a dash for none."""

    def cell(rows: Sequence[Row]) -> str:
        values = [getattr(row, kind)[name] for row in rows if getattr(row, kind).get(name) is not None]
        return write(statistics.fmean(values)) if values else ABSENT

    return cell


def digits(count: int) -> Callable[[Any], str]:
    """Writes numbers with so many digits behind the point."""
    return lambda value: number(value, count)


# ---- views --------------------------------------------------------------------------------------------------------


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
        y: figure on the plot's vertical axis, or an empty line for no plot.
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
    y: str = ""
    y_label: str = ""
    is_log: bool = False
    group: str | None = None

    def __call__(self, rows: Sequence[Row]) -> str:
        """Title, text and a table per subject; empty where there are no rows of the study."""
        rows = of_study(rows, self.study)
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
        has_notes = any(row.note for row in rows)
        heads = ["", "", "seconds", "CPU s", "threads", *([f"× {baseline}"] if baseline else []),
                 *(column.heading for column in columns), *(["peak"] if has_peaks else []),
                 *([""] if has_notes else [])]  # fmt: skip
        lines = []
        for row in rows:
            if row.seconds is None:
                lines.append([row.way, "", ABSENT, *[""] * (len(heads) - 4), row.note])
                continue
            cells = [row.way, "●" if row.way in best else "", spread(row), duration(row.costs["cpu"]),
                     str(row.setting.get("threads", ""))]  # fmt: skip
            if baseline:
                has_ratio = "ratio" in row.costs
                cells.append(f"{row.costs['ratio']:.2f} ({row.costs['cpu_ratio']:.2f})" if has_ratio else ABSENT)
            cells += [c.write(row.figures[c.key]) if c.key in row.figures else ABSENT for c in columns]
            cells += [megabytes(row.costs["peak_bytes"]) if "peak_bytes" in row.costs else ABSENT] if has_peaks else []
            lines.append([*cells, row.note] if has_notes else cells)
        return format_table(heads, lines)

    @property
    def chart(self) -> Chart:
        """The view's figure against seconds, a panel per subject."""
        log = "xy" if self.is_log else "x"
        return Chart(self.study, self.title, Axis("seconds", "seconds, median", "costs"), Axis(self.y, self.y_label),
                      panel="subject", curve=self.group or "", point="way", log=log)  # fmt: skip


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
