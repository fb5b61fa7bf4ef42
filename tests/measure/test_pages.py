"""What reports and pages say is what the rows say."""

from dataclasses import replace
from pathlib import Path

import pytest
from measure.tiny_runs import shows
from scenes import refusing

from tinysplat.measure.pages import fill_pages, filled, pages
from tinysplat.measure.rows import ROWS, Row, RowFile
from tinysplat.measure.show import quality
from tinysplat.measure.studies import STUDIES, find_study
from tinysplat_runtime.errors import InputError

ROOT = Path(__file__).parents[2]


def row(way: str, seconds: float = 1.0, **figures: float) -> Row:
    costs = dict.fromkeys(("seconds", "low", "high", "cpu"), seconds)
    return Row("formats", "2×256×256", way, {"profile": way.split()[0]}, figures, costs)


def test_every_study_has_tables_that_say_nothing_of_no_rows(tmp_path):
    names: list[str] = [*quality.TABLES]
    for name in STUDIES:
        study = find_study(name)
        names += study.tables
        assert all(table([]) == "" for table in study.tables.values()), name
        assert not any(plot(tmp_path / "p.png", []) for plot in study.plots.values()), name
    assert len(names) == len(set(names))  # marks name tables


def test_marked_places_are_filled_from_rows_and_their_faults_named(tmp_path):
    (tmp_path / "docs").mkdir()
    file = RowFile(tmp_path / "benchmarks" / "reports" / "day" / ROWS)
    file.add(row("balanced 0", bytes=1000, psnr_decoded_raw=40.0))
    file.add(replace(row("balanced 0", bytes=9000), subject="other"))
    mark = "<!-- measured day/rows.jsonl: formats where subject=2×256×256 -->"
    (tmp_path / "README.md").write_text(f"Before {mark}\nold\n<!-- end --> behind")
    assert fill_pages(tmp_path) == [tmp_path / "README.md"] and fill_pages(tmp_path) == []
    text = (tmp_path / "README.md").read_text()
    assert text.startswith(f"Before {mark}\n") and text.endswith("\n<!-- end --> behind")
    assert shows(text, 40) and shows(text, 1) and not shows(text, 9) and "old" not in text
    for words in ("nonsense", "list"):  # no table of that name, no rows of that study
        with refusing(InputError, f"'{words}'"):
            filled(f"<!-- measured day/rows.jsonl: {words} --><!-- end -->", tmp_path)


@pytest.mark.parametrize("page", pages(ROOT), ids=lambda path: path.name)
def test_every_marked_figure_is_that_of_the_committed_rows(page):
    text = page.read_text("utf-8")
    assert filled(text, ROOT, page.name) == text, "tinysplat bench --docs fills it"
