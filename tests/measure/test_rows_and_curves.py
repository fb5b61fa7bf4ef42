"""Interleaved timing, what two runs have in common, and marked places."""

from __future__ import annotations

import math
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import pytest

from tinysplat.measure.clock import Baseline, Effort, Variant, measure
from tinysplat.measure.rows import ROWS, Row, RowFile, changed_since, git, read_rows
from tinysplat.measure.show.pages import agreement, commits_of_rows, fill_pages, filled, pages
from tinysplat.measure.studies import STUDIES, find_study
from tinysplat.measure.subjects.made import made_gaussians
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.check import file_loss
from tinysplat_runtime.formats.table import save_gaussians

ROOT = Path(__file__).parents[2]


def row(way: str, seconds: float = 1.0, **figures: float) -> Row:
    costs = dict.fromkeys(("seconds", "low", "high", "cpu"), seconds)
    return Row("formats", "2×256×256", way, {"profile": way.split()[0]}, figures, costs)


# ---- the clock ---------------------------------------------------------------------------------------------------


def spin(seconds: float) -> None:
    """Work for so many CPU seconds, which a machine that others use does not stretch."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def test_rounds_interleave_variants_after_one_that_warms_up_and_gives_figures():
    calls: list[str] = []
    variants = [Variant(name, lambda n=name: calls.append(n) or n, lambda n: {"name": n}) for name in "AB"]
    rows = measure("s", "c", variants, Effort(rounds=3))
    assert "".join(calls) == "AB" + "ABABAB"
    assert [(r.costs["rounds"], r.figures["name"]) for r in rows] == [(3, "A"), (3, "B")]


def test_a_baseline_runs_beside_its_variant_and_gives_the_ratio():
    variant = Variant("slow", lambda: spin(0.02), baseline=Baseline("fast", lambda: spin(0.01)))
    (found,) = measure("s", "c", [variant], Effort(rounds=5))
    assert found.setting["baseline"] == "fast"
    assert 1.5 < found.costs["cpu_ratio"] < 2.5 and found.costs["ratio"] > 0


# ---- shown -------------------------------------------------------------------------------------------------------


def test_runs_that_agree_differ_in_nothing_but_time_and_a_figure_that_moved_is_named():
    before, now = [row("v", 1, psnr=math.inf)], [row("v", 2, psnr=math.inf)]
    assert "1 figures that do not depend on time 1 are identical" in agreement(before, now)[0]
    assert any("bytes was 10, is 11" in line for line in agreement([row("v", bytes=10)], [row("v", bytes=11)]))


# ---- studies and pages -------------------------------------------------------------------------------------------


def test_every_study_is_there_and_has_tables_that_say_nothing_of_no_rows(tmp_path):
    names: list[str] = []
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
    assert text.startswith(f"Before {mark}\n**2×256×256**") and text.endswith("\n<!-- end --> behind")
    assert "40.00" in text and "9.0" not in text and "old" not in text
    for words, fault in (("nonsense", "no study has a table"), ("free", "has no rows for 'free'")):
        with pytest.raises(InputError, match=fault):
            filled(f"<!-- measured day/rows.jsonl: {words} --><!-- end -->", tmp_path)


def test_figures_of_other_code_are_told_by_the_commits_of_their_runs(tmp_path):
    checkout = ("-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c")
    commits = []
    for text in ("one", "two"):
        (tmp_path / "runtime").mkdir(exist_ok=True)
        (tmp_path / "runtime" / "code.py").write_text(text)
        for words in (("init", "-q"), ("add", "."), ("commit", "-q", "-m", text)):
            subprocess.run(["git", *checkout, *words], check=True)
        commits.append(git(tmp_path, "rev-parse", "HEAD"))
    (tmp_path / "README.md").write_text("<!-- measured day/rows.jsonl: formats --><!-- end -->")
    file = RowFile(tmp_path / "benchmarks" / "reports" / "day" / ROWS)
    file.add(row("balanced"))
    assert commits_of_rows(tmp_path) == {"day/rows.jsonl": []}
    for commit in commits:
        file.add(Row("run", commit, "formats", {}, {"commit": commit}))
    assert commits_of_rows(tmp_path) == {"day/rows.jsonl": commits}
    found = [changed_since(commit, tmp_path) for commit in (*commits, "nonsense")]
    assert found == [["runtime/code.py"], [], None]


def test_plots_of_pages_are_drawn_from_the_newest_report_that_has_their_rows(tmp_path):
    (tmp_path / "docs").mkdir()
    page = tmp_path / "README.md"
    page.write_text("Before\n<!-- plotted free -->\n![Error](docs/o.png)\n\nold\n<!-- end -->\nbehind")
    assert fill_pages(tmp_path) == [] and not (tmp_path / "docs" / "o.png").exists()
    reports = tmp_path / "benchmarks" / "reports"
    for day, study in (("2026-01-01", "free"), ("2026-01-02", "free"), ("2026-01-03", "waits")):
        RowFile(reports / day / ROWS).add(replace(row("balanced", psnr_decoded_raw=40.0, bytes=1e3), study=study))
    assert fill_pages(tmp_path) == [page] and fill_pages(tmp_path) == []
    found = page.read_text()
    assert "![Error](docs/o.png)\n\n*From [2026-01-02](benchmarks/reports/2026-01-02/report.md).*\n" in found
    assert "old" not in found and found.startswith("Before") and found.endswith("behind")
    assert (tmp_path / "docs" / "o.png").stat().st_size > 5000
    page.write_text("<!-- plotted nonsense -->\n![Error](docs/o.png)\n<!-- end -->")
    with pytest.raises(InputError, match="no study has a plot 'nonsense'"):
        fill_pages(tmp_path)


@pytest.mark.parametrize("page", pages(ROOT), ids=lambda path: path.name)
def test_every_marked_figure_is_that_of_the_committed_rows(page):
    text = page.read_text("utf-8")
    assert filled(text, ROOT, page.name) == text, "tinysplat bench --docs fills it"


def test_what_the_paper_prints_is_quoted_as_in_the_committed_report_and_ours_stands_beside() -> None:
    folder = ROOT / "benchmarks" / "reports" / "2026-11-22" / "scenes" / "paper"

    def cells(text: str) -> list[list[str]]:
        lines = [line for line in text.splitlines() if line.startswith("|") and not line.startswith("|-")]
        return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]

    rows, quoted = read_rows(folder), cells((folder / "report.md").read_text("utf-8"))
    for name, table in find_study("paper").tables.items():
        lines = cells(table(rows))
        assert len(lines) > 4 and [line for line in lines if line not in quoted] == [], name


@pytest.mark.parametrize(("way", "suffix"), [("SPZ", ".spz"), ("compressed PLY", ".compressed.ply")])
def test_formats_are_measured_on_the_scene_that_committed_figures_are_of(tmp_path, way, suffix):
    """Writers may become better; another scene of the same name would make figures that do not compare."""
    rows = read_rows(ROOT / "benchmarks" / "reports" / "2026-11-24" / "formats.jsonl")
    committed = next(row.figures for row in rows if row.way == way)
    gaussians = made_gaussians(2, 128, 128, 3)
    save_gaussians(tmp_path / f"g{suffix}", gaussians)
    loss = file_loss(tmp_path / f"g{suffix}", gaussians)
    assert loss.bytes == pytest.approx(committed["bytes"], rel=0.02)
    assert loss.psnr == pytest.approx(committed["psnr_decoded_raw"], abs=0.1)
