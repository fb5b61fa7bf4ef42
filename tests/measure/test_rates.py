"""Bytes of other formats at as many decibels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tinysplat.measure.rows import Row
from tinysplat.measure.studies.rates import LISTS, RATES, STUDY


def file(way: str, size: int, kb: float, fitted: float) -> Row:
    figures = {"bytes": 1000 * kb, "fitted": fitted, "fitted_ssim": 0.9, "fitted_worst": fitted, "gaussians": 1000}
    return Row(STUDY, "room", way, {"size": size}, figures, {"cpu": 30.0})


def test_rows_of_another_study_are_not_plotted(tmp_path: Path) -> None:
    rows = [replace(file(LISTS, 80, 100, 30), study="gate")]
    assert not any(plot(tmp_path / "rates.png", rows) for plot in RATES.plots.values())


def test_bytes_of_other_formats_are_those_at_as_many_decibels(tmp_path: Path) -> None:
    rows = [file(LISTS, 80, 100, 30), file(LISTS, 150, 150, 40)]
    rows += [file("SPZ", 80, 200, 29), file("SPZ", 150, 400, 31)]  # 283 KB at 30 dB, none at 40
    words = RATES.tables["rates in words"](rows)
    assert "SPZ takes 2.8" in words
    for name, plotted in {STUDY: True, "rates seconds": False}.items():  # no row has steps
        assert RATES.plots[name](tmp_path / f"{name}.png", rows) is plotted
        assert (tmp_path / f"{name}.png").is_file() is plotted
    table = RATES.tables[STUDY](rows)
    assert table.count("\n") == 3 and "200" in table and "40.00" in table
