"""The study of refinement: a row per number of photos and budget, of the best state that the budget reached."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from evaluation_scenes import write_eval_scene
from tiny_runs import cells, rows_of, tiny_run

from tinysplat.measure.studies import refining
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.gaussian.gaussians import Gaussians


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list:
    folder = tmp_path_factory.mktemp("refining")
    windows = [{"kind": "multi", "context": [0, 1, 3, 4], "target": [2]}]
    scene = write_eval_scene(folder / "plane", windows, frames=5)
    run = tiny_run(folder, scene)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(refining, "QUICK_SECONDS", (0, 1, 2))
        found = rows_of("refine", run)
    assert run.left_out == []
    return found


def test_larger_windows_stand_in_for_smaller_ones(rows: list) -> None:
    assert [(row.setting["views"], row.setting["given"]) for row in rows] == [
        (views, given) for views in (3, 4) for given in (0, 1, 2)
    ]
    assert [row.subject for row in rows[::3]] == ["plane multi 0,1,3", "plane multi 0,1,3,4"]


def test_budgets_are_kept_and_nothing_is_done_for_none(rows: list) -> None:
    for start, *refined in (rows[:3], rows[3:]):
        assert start.costs["seconds"] == 0 and (start.figures["steps"], start.figures["kept"]) == (0, 0)
        steps = [row.figures["steps"] for row in refined]
        assert steps[0] <= steps[1] > 0
        for row in refined:
            figures = row.figures
            assert figures["bytes"] > 1000 and figures["psnr"] != figures["psnr_defined"]
            assert figures["kept"] <= figures["steps"]
            if figures["kept"] == 0:
                assert figures["psnr"] == start.figures["psnr"]


def test_rows_become_a_table_and_a_plot(rows: list, tmp_path: Path) -> None:
    table = refining.refine_table(rows)
    assert cells(table)["3"][0] == "2 s" and table.count("\n") == 1 + len(rows)
    assert refining.refine_plot(tmp_path / "plot.png", rows) and (tmp_path / "plot.png").stat().st_size > 1000


def test_curves_are_of_both_kinds_of_file_and_become_a_table_and_a_plot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def darker(_: Runtime, gaussians: Gaussians, scene: object, **options: object) -> Gaussians:
        return replace(gaussians, sh=gaussians.sh - 0.5, extra_layers=())

    monkeypatch.setattr(Runtime, "refine", darker)
    windows = [{"kind": "multi", "context": [0, 1, 3, 4], "target": [2]}]
    run = tiny_run(tmp_path, write_eval_scene(tmp_path / "plane", windows, frames=5), qps=(0.0, 24.0))
    rows = rows_of("refined", run)
    assert [(row.way, row.setting["qp"]) for row in rows] == [
        (way, qp) for way in ("unrefined", "refined") for qp in (0.0, 24.0)
    ]
    for fine, coarse in (rows[:2], rows[2:]):
        assert fine.figures["bytes"] > 1.5 * coarse.figures["bytes"]
    assert rows[0].figures["psnr"] > rows[2].figures["psnr"] + 3
    assert refining.curve_plot(tmp_path / "plot.png", rows) and (tmp_path / "plot.png").stat().st_size > 1000
    made = [
        replace(row, figures={"bytes": size, "psnr": psnr})
        for row, size, psnr in zip(rows, (100e3, 20e3, 160e3, 40e3), (27.0, 25.0, 28.0, 26.0), strict=True)
    ]
    found = cells(refining.curve_table(made))
    assert found["40"] == ["1", "25.86", "26.00", "+0.14", "+0.14"] and "20" not in found
