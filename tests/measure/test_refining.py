"""The study of refinement: a row per number of photos and budget, of the best state that the budget reached."""

from __future__ import annotations

from pathlib import Path

import pytest
from evaluation_scenes import write_eval_scene
from tiny_runs import cells, rows_of, tiny_run

from tinysplat.measure.studies import refining


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
