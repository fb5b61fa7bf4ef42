"""`bench pruned`: captures as one list, compressed by a user with cameras, by one without, and whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from measure.evaluation_scenes import write_eval_scene
from measure.tiny_runs import rows_of, shows, tiny_run

from tinysplat.measure.studies import find_study

pytest.importorskip("PIL")
pytest.importorskip("numba")


def test_a_row_for_each_way_and_quality(tmp_path: Path) -> None:
    run = tiny_run(tmp_path, write_eval_scene(tmp_path / "plane", frames=9))
    run.options = replace(run.options, qps=(0.0, 12.0))
    rows = rows_of("pruned", run)
    assert run.left_out == []
    for whole, blind, seeing in zip(rows[0::3], rows[1::3], rows[2::3], strict=True):
        assert whole.figures["kept"] == whole.figures["given"] and not whole.note
        assert seeing.figures["bytes"] <= whole.figures["bytes"]
        assert blind.figures["bytes"] <= whole.figures["bytes"]
        assert all(row.figures["psnr_raw"] == rows[0].figures["psnr_raw"] for row in (whole, blind, seeing))
    table = find_study("pruned").tables["pruned in short"](rows)
    assert shows(table, rows[0].figures["given"])
    assert all(shows(table, row.figures["psnr_raw"] - row.figures["psnr"]) for row in rows)
    assert shows(table, max(rows[n].figures["psnr"] - rows[n + 1].figures["psnr"] for n in (0, 3)))
    assert [row.figures for row in rows_of("pruned", run)] == [row.figures for row in rows]
