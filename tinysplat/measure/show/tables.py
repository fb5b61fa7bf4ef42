"""Tables for people and for spreadsheets, and how numbers are written in them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

ABSENT = "–"


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table whose columns line up: the first to the left, the others to the right."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]

    def text(line: Sequence[str]) -> str:
        cells = [line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]
        return f"| {' | '.join(cells)} |"

    rule = "|".join(["-" * (widths[0] + 2), *("-" * (w + 1) + ":" for w in widths[1:])])
    return "\n".join([text(lines[0]), f"|{rule}|", *(text(line) for line in lines[1:])])


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
