"""Committed reports say what the tables of today make of their rows."""

from __future__ import annotations

from pathlib import Path

import pytest

from tinysplat.measure.rows import ROWS, Row, read_rows
from tinysplat.measure.show.pages import goal_table
from tinysplat.measure.studies import STUDIES, find_study

REPORTS = Path(__file__).parents[2] / "benchmarks" / "reports"

OLDER = {"free", "free in short"}
"""Tables whose rows have figures today that committed ones lack."""


def tables(rows: list[Row]) -> dict[str, str]:
    """Every table that has something to say of rows."""
    found = {}
    for name in STUDIES:
        for table, write in find_study(name).tables.items():
            if table not in OLDER and (text := write(rows)):
                found[table] = text
    return found


@pytest.mark.parametrize(
    "folder", sorted(path.parent for path in REPORTS.glob("**/report.md") if path.with_name(ROWS).is_file()),
    ids=lambda path: str(path.relative_to(REPORTS)),
)  # fmt: skip
def test_reports_hold_every_table_of_their_rows(folder: Path) -> None:
    text, rows = (folder / "report.md").read_text("utf-8"), read_rows(folder)
    found = tables(rows)
    assert found
    for name, table in found.items():
        assert table in text, f"{name}: write_report of tinysplat.measure.show.pages writes it anew"
    assert goal_table(rows) in text
