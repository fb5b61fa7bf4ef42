"""Rows that survive a kill, interleaved timing, fits and BD-rate, what two runs have in common, and marked places."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import pytest

from tinysplat.measure.clock import Baseline, Effort, Variant, measure, summarised
from tinysplat.measure.curves import Fit, bd_rate, bytes_at, decibels_at
from tinysplat.measure.rows import ROWS, Row, RowFile, read_rows
from tinysplat.measure.show.pages import agreement, fill_pages, filled, goal_table, pages, size_at_equal_db
from tinysplat.measure.show.tables import View, front
from tinysplat.measure.studies import STUDIES, find_study
from tinysplat_runtime.errors import InputError

ROOT = Path(__file__).parents[2]


def row(way: str, seconds: float = 1.0, **figures: float) -> Row:
    costs = dict.fromkeys(("seconds", "low", "high", "cpu"), seconds)
    return Row("encode", "2×256×256", way, {"profile": way.split()[0]}, figures, costs)


# ---- rows --------------------------------------------------------------------------------------------------------


def test_rows_survive_the_file_and_of_two_the_later_counts(tmp_path):
    file = RowFile(tmp_path / ROWS)
    first = Row("s", "case", "way", {"qp": 0.0, "context": (0, 2)}, {"psnr": math.inf, "x": {"y": None}}, stamp="a")
    kept = file.add(first)
    assert kept.figures["psnr"] == math.inf and kept.setting["context"] == [0, 2]
    assert RowFile(tmp_path / ROWS).find(first) == kept
    assert file.find(replace(first, stamp="b")) is None and file.find(replace(first, stamp="")) is None
    second = file.add(replace(first, stamp="b", figures={"psnr": 1.0}))
    assert read_rows(tmp_path) == [second] == list(RowFile(tmp_path / ROWS))


@pytest.mark.parametrize("text", ["[]\n", "3\n", "not json\n", '{"study": "s", "rows": 3}\n'])
def test_a_file_of_something_else_is_refused(tmp_path, text):
    (tmp_path / ROWS).write_text(text)
    with pytest.raises(InputError, match=r"rows\.jsonl: line 1: not a row of measurements"):
        read_rows(tmp_path)


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


def test_the_budget_ends_the_rounds_but_not_before_the_least():
    (found,) = measure("s", "c", [Variant("v", lambda: spin(0.01))], Effort(rounds=50, budget_s=0, least=2))
    assert found.costs["rounds"] == 2


def test_medians_ignore_an_outlier():
    costs = summarised([(1.0, 0.5), (1.1, 0.5), (9.0, 0.6)])
    assert (costs["seconds"], costs["cpu"], costs["rounds"]) == (1.1, 0.5, 3)
    assert costs["low"] <= costs["seconds"] <= costs["high"]


# ---- curves ------------------------------------------------------------------------------------------------------

REFERENCE = [(10_000, 35.0), (20_000, 38.0), (40_000, 41.0), (80_000, 44.0)]


@pytest.mark.parametrize("share", [0.5, 0.9, 1.7])
def test_bd_rate_of_a_curve_scaled_in_bytes_is_the_scale(share):
    scaled = [(size * share, db) for size, db in REFERENCE]
    assert bd_rate(REFERENCE, scaled) == pytest.approx(share - 1, abs=1e-3)
    assert bd_rate(scaled, REFERENCE) == pytest.approx(1 / share - 1, abs=1e-3)


def test_bd_rate_on_a_straight_line_in_log_bytes_is_the_shift_in_db():
    # 3 dB double the bytes here, so that 1 dB more at equal bytes is 2^(−1/3) of the bytes at equal dB.
    better = [(size, db + 1) for size, db in REFERENCE]
    assert bd_rate(REFERENCE, better) == pytest.approx(2 ** (-1 / 3) - 1, abs=1e-4)


def test_limits_choose_the_range_and_beaten_points_do_not_count():
    crossing = [(5_000, 35.0), (40_000, 41.0), (160_000, 44.0), (170_000, 39.0)]
    assert bd_rate(REFERENCE, crossing, (35, 37)) < 0 < bd_rate(REFERENCE, crossing, (42, 44))


def test_bytes_at_passes_through_the_points_and_ends_with_them():
    assert bytes_at(REFERENCE, 38.0) == pytest.approx(20_000)
    assert bytes_at(REFERENCE, 34.9) is None and bytes_at(REFERENCE, 44.1) is None
    assert decibels_at(REFERENCE, 20_000) == pytest.approx(38)
    assert decibels_at(REFERENCE, 15_000) == pytest.approx(38 - 3 * math.log2(4 / 3), abs=1e-4)
    assert decibels_at(REFERENCE, 9_999) is None and decibels_at(REFERENCE, 90_000) == 44
    assert decibels_at([(30_000, 38.0), (60_000, 37.9)], 50_000) == 38  # a larger file that is worse
    for other in ([(1_000, 20.0), (2_000, 25.0)], REFERENCE[:1]):
        with pytest.raises(InputError, match="curve"):
            bd_rate(REFERENCE, other)


def test_growth_is_fitted_with_its_fixed_cost_and_where_it_becomes_proportional():
    x = [2.0**i for i in range(11)]
    fit = Fit.of(x, [3 * value for value in x])
    assert (fit.slope, fit.per_unit) == (pytest.approx(1), pytest.approx(3)) and fit.fixed == pytest.approx(0, abs=1e-9)
    assert "over the whole range" in fit.sentence("views", str, 1)
    fit = Fit.of(x, [10.0 + value for value in x])
    assert (fit.fixed, fit.per_unit) == (pytest.approx(10, rel=1e-6), pytest.approx(1, rel=1e-6))
    assert fit.linear_from is not None and 32 <= fit.linear_from <= 128 and fit.slope < 1
    assert Fit.of(x[:4], [value**2 for value in x[:4]]).sentence("views", str, 1).startswith("faster")


# ---- shown -------------------------------------------------------------------------------------------------------


def test_the_front_holds_what_nothing_beats_in_everything():
    view = View("encode", "", "", costs=("bytes",), gains=("psnr",))
    rows = [
        row("fast", 1, bytes=100, psnr=40),
        row("small", 2, bytes=80, psnr=40),
        row("beaten", 2, bytes=100, psnr=39),
        row("good", 3, bytes=90, psnr=45),
    ]
    assert front(view, rows) == {"fast", "small", "good"}


def encoded(profile: str, psnr: float, size: float) -> Row:
    return row(f"{profile} {psnr}", psnr_decoded_raw=psnr, bytes=float(size))


def test_goals_hold_sizes_at_equal_db_and_leave_out_what_was_not_measured():
    rows = [encoded("paper", db, 100_000 * 2 ** (db - 37)) for db in (37, 42)]
    rows += [encoded("balanced", db, 40_000 * 2 ** (db - 37)) for db in (37, 39, 42)]
    assert size_at_equal_db(rows) == pytest.approx(0.4)
    assert goal_table([]) == "" and "met" in goal_table(rows) and "libavcodec" not in goal_table(rows)


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
    mark = "<!-- measured day/rows.jsonl: encode where subject=2×256×256 -->"
    (tmp_path / "README.md").write_text(f"Before {mark}\nold\n<!-- end --> behind")
    assert fill_pages(tmp_path) == [tmp_path / "README.md"] and fill_pages(tmp_path) == []
    text = (tmp_path / "README.md").read_text()
    assert text.startswith(f"Before {mark}\n### Encoding") and text.endswith("\n<!-- end --> behind")
    assert "40.00" in text and "9.0" not in text and "old" not in text
    for words, fault in (("nonsense", "no study has a table"), ("decode", "has no rows for 'decode'")):
        with pytest.raises(InputError, match=fault):
            filled(f"<!-- measured day/rows.jsonl: {words} --><!-- end -->", tmp_path)


def test_plots_of_pages_are_drawn_from_the_newest_report_that_has_their_rows(tmp_path):
    (tmp_path / "docs").mkdir()
    page = tmp_path / "README.md"
    page.write_text("Before\n<!-- plotted overview -->\n![Error](docs/o.png)\n\nold\n<!-- end -->\nbehind")
    assert fill_pages(tmp_path) == [] and not (tmp_path / "docs" / "o.png").exists()
    reports = tmp_path / "benchmarks" / "reports"
    for day, study in (("2026-01-01", "encode"), ("2026-01-02", "encode"), ("2026-01-03", "decode")):
        RowFile(reports / day / ROWS).add(replace(row("balanced", psnr_decoded_raw=40.0), study=study))
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
