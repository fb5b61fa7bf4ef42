"""Interleaved timing, the Pareto front, growth fits and the comparison of reports."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tinysplat.bench.agreement import compare_reports, read_report
from tinysplat.bench.goals import goal_lines, size_at_equal_db
from tinysplat.bench.growth import Fit
from tinysplat.bench.report import finite_json
from tinysplat.bench.timing import Baseline, Effort, Row, Seconds, Stage, Variant, measure, summarise
from tinysplat.bench.views import VIEWS, Front, View
from tinysplat_runtime.errors import InputError


def spin(seconds: float) -> None:
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        pass


def test_rounds_interleave_variants_after_one_that_warms_up() -> None:
    calls: list[str] = []
    stage = Stage("s", "c", [Variant(name, lambda n=name: calls.append(n)) for name in "AB"])
    rows = measure(stage, Effort(rounds=3, budget_s=10))
    assert "".join(calls) == "AB" + "ABABAB"
    assert [row.seconds.rounds for row in rows if row.seconds] == [3, 3]


def test_a_baseline_runs_beside_its_variant_and_gives_the_ratio() -> None:
    variant = Variant("slow", lambda: spin(0.02), baseline=Baseline("fast", lambda: spin(0.01)))
    (row,) = measure(Stage("s", "c", [variant]), Effort(rounds=5, budget_s=10))
    assert row.baseline is not None
    assert row.baseline[0] == "fast"
    assert row.ratio is not None
    assert 1 < row.ratio < 4  # twice the work, on a machine that others use too


def test_the_budget_ends_the_rounds_but_not_before_the_least() -> None:
    (row,) = measure(Stage("s", "c", [Variant("v", lambda: spin(0.01))]), Effort(rounds=50, budget_s=0, least=2))
    assert row.seconds is not None
    assert row.seconds.rounds == 2


def test_figures_come_from_the_result_of_the_run() -> None:
    (row,) = measure(Stage("s", "c", [Variant("v", lambda: 7, lambda n: {"bytes": n})]), Effort(1, 0, 1))
    assert row.figures == {"bytes": 7}


def test_medians_ignore_an_outlier() -> None:
    seconds = summarise([(1.0, 0.5), (1.1, 0.5), (9.0, 0.6)])
    assert (seconds.median, seconds.cpu, seconds.rounds) == (1.1, 0.5, 3)
    assert seconds.low <= seconds.median <= seconds.high


def row(variant: str, seconds: float, **figures: float) -> Row:
    return Row("encode", "case", variant, seconds=Seconds(seconds, seconds, seconds, seconds, 3), figures=figures)


def test_the_front_holds_what_nothing_beats_in_everything() -> None:
    view = View("", "", (), costs=("bytes",), gains=("psnr",))
    rows = [
        row("fast", 1, bytes=100, psnr=40),
        row("small", 2, bytes=80, psnr=40),
        row("beaten", 2, bytes=100, psnr=39),
        row("good", 3, bytes=90, psnr=45),
    ]
    assert Front.of(view, rows).members == {"fast", "small", "good"}


def test_every_view_plots_a_figure_that_it_counts_or_shows() -> None:
    for view in VIEWS.values():
        shown = {column.key for column in view.columns}
        assert view.y is None or view.y in shown
        assert {*view.costs, *view.gains} <= shown


def test_proportional_growth_has_slope_one_and_no_fixed_cost() -> None:
    x = [1, 2, 4, 8]
    fit = Fit.of(x, [3.0 * value for value in x])
    assert fit.slope == pytest.approx(1)
    assert fit.fixed == pytest.approx(0, abs=1e-9)
    assert fit.per_unit == pytest.approx(3)
    assert "over the whole range" in fit.sentence("views", str, 1)


def test_a_fixed_cost_is_found_and_where_growth_becomes_proportional() -> None:
    x = [2.0**i for i in range(11)]
    fit = Fit.of(x, [10.0 + value for value in x])
    assert fit.fixed == pytest.approx(10, rel=1e-6)
    assert fit.per_unit == pytest.approx(1, rel=1e-6)
    assert fit.linear_from is not None
    assert 32 <= fit.linear_from <= 128
    assert fit.slope < 1


def test_growth_faster_than_in_proportion_is_said() -> None:
    fit = Fit.of([1, 2, 4, 8], [1.0, 4.0, 16.0, 64.0])
    assert fit.linear_from is None
    assert fit.sentence("views", str, 1).startswith("faster")


def report(**figures: float) -> dict:
    return finite_json({"rows": [row("v", figures.pop("seconds"), **figures).to_json()]})


def test_reports_that_agree_differ_in_nothing_but_time() -> None:
    agreement = compare_reports(report(seconds=1, psnr=np.inf), report(seconds=2, psnr=np.inf))
    assert (agreement.rows, agreement.figures, agreement.differences) == (1, 1, ())
    assert list(agreement.ratios.values()) == [2]


def test_a_figure_that_moved_is_named() -> None:
    (difference,) = compare_reports(report(seconds=1, bytes=10), report(seconds=1, bytes=11)).differences
    assert (difference.figure, difference.before, difference.now) == ("bytes", 10, 11)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"rows": 3}', "not json"])
def test_what_is_no_report_is_refused(tmp_path, text: str) -> None:
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(InputError, match=r"report\.json"):
        read_report(tmp_path)


def test_a_missing_report_is_refused(tmp_path) -> None:
    with pytest.raises(InputError):
        read_report(tmp_path / "nowhere")


def encode(profile: str, psnr: float, size: int) -> Row:
    seconds = Seconds(1, 1, 1, 1, 3)
    figures = {"psnr_decoded_raw": psnr, "bytes": float(size)}
    return Row("encode", "case", f"{profile} {psnr}", settings={"profile": profile}, seconds=seconds, figures=figures)


def test_sizes_are_compared_at_equal_db() -> None:
    rows = [encode("paper", db, 100_000 * 2 ** (db - 37)) for db in (37, 42)]
    rows += [encode("balanced", db, 40_000 * 2 ** (db - 37)) for db in (37, 39, 42)]
    assert size_at_equal_db(rows) == pytest.approx(0.4)


def test_goals_that_were_not_measured_are_left_out() -> None:
    assert list(goal_lines([])) == []
    rows = [
        encode("paper", 37, 1000),
        encode("paper", 42, 2000),
        encode("balanced", 37, 990),
        encode("balanced", 42, 1980),
    ]
    text = "\n".join(goal_lines(rows))
    assert "99.00 % | 45.00 % | not met" in text
    assert "libavcodec" not in text
