"""Rows as tables, and how numbers are written in them.

A `Listing` has a line per group of rows.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..rows import Row, grouped, of_study

ABSENT = "–"

Cell = Callable[[Sequence[Row]], str]
"""What a table says of a group of rows."""

Table = Callable[[Sequence[Row]], str]
"""Rows of a run to Markdown; empty where none is its."""

Write = Callable[[Any], str]
"""What writes a value into a cell."""


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table whose columns line up: the first to the left, the others to the right."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]

    def text(line: Sequence[str]) -> str:
        cells = [line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]
        return f"| {' | '.join(cells)} |"

    rule = "|".join(["-" * (widths[0] + 2), *("-" * (w + 1) + ":" for w in widths[1:])])
    return "\n".join([text(lines[0]), f"|{rule}|", *(text(line) for line in lines[1:])])


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


def duration(value: float | None) -> str:
    """Seconds in the unit that suits them."""
    if value is None:
        return ABSENT
    if value >= 1:
        return f"{value:.2f} s"
    return f"{1000 * value:.1f} ms" if value >= 1e-3 else f"{1e6 * value:.0f} µs"


# ---- listings -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Listing:
    """A table of a study's rows.

    Attributes:
        study: whose rows.
        columns: what each line says, by heading; the first one stands to the left.
        by: attributes and settings whose values tell lines apart; empty for a line per row.
        sections: the attribute that has a table per value, under that value; empty for one table.
        wanted: which of the rows are shown.
    """

    study: str
    columns: Mapping[str, Cell]
    by: Sequence[str] = ()
    sections: str = ""
    wanted: Callable[[Row], bool] = lambda _: True

    def __call__(self, rows: Sequence[Row]) -> str:
        """Markdown; empty where no row is of the study."""
        rows = list(filter(self.wanted, of_study(rows, self.study)))
        if not rows:
            return ""
        parts = grouped(rows, self.sections) if self.sections else {("",): rows}
        tables = [f"**{name}**\n\n{self.table(part)}" if name else self.table(part) for (name,), part in parts.items()]
        return "\n\n".join(tables)

    def table(self, rows: Sequence[Row]) -> str:
        """One table of rows, whatever their study."""
        columns = self.cells(rows)
        return format_table(list(columns), zip(*columns.values(), strict=True))

    def cells(self, rows: Sequence[Row]) -> dict[str, list[str]]:
        """What the table's columns say by heading, without those of which no row says anything."""
        groups = grouped(rows, *self.by).values() if self.by else [[row] for row in rows]
        columns = {head: [cell(group) for group in groups] for head, cell in self.columns.items()}
        return {head: cells for head, cells in columns.items() if set(cells) != {ABSENT}}


def said(name: str, write: Write = str) -> Cell:
    """What a group has in common: an attribute or a setting of its first row."""
    return lambda rows: write(getattr(rows[0], name, rows[0].setting.get(name)))


def mean(name: str, write: Write, kind: str = "figures", *, way: str = "") -> Cell:
    """Mean of a figure, or of a cost with `kind` costs, over the rows of a group that have it; a dash for none.

    Where a `way` is given, over its rows alone.
    """

    def cell(rows: Sequence[Row]) -> str:
        measured = [getattr(row, kind).get(name) for row in rows if way in ("", row.way)]
        values = [value for value in measured if value is not None]
        return write(statistics.fmean(values)) if values else ABSENT

    return cell


def digits(count: int) -> Write:
    """Writes numbers with so many digits behind the point."""
    return lambda value: number(value, count)
