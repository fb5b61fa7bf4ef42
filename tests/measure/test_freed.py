"""`bench free`: points of files of no pixels, ours over Q_g and the others beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import make_free_gaussians
from tiny_runs import tiny_run

import tinysplat_runtime as ts
from tinysplat.commands.bench import TAKE_PATHS
from tinysplat.measure.rows import Row
from tinysplat.measure.studies.freed import FREE, OURS, free_rows

pytest.importorskip("plyfile")
pytest.importorskip("PIL")


def test_every_format_has_its_points_and_what_ours_takes_at_the_same_decibels(tmp_path: Path) -> None:
    scene = tmp_path / "scene.ply"
    ts.save_gaussians(scene, make_free_gaussians(700, 1, np.random.default_rng(2)))
    run = tiny_run(tmp_path / "report")
    run.paths, run.options = [scene, tmp_path / "none.ply"], replace(run.options, qps=(-30.0, -12.0, 6.0))
    rows = list(free_rows(run))
    assert len(run.left_out) == 1 and "none.ply" in run.left_out[0]
    ways = {row.way for row in rows}
    assert ways == {OURS, "SPZ v4", "SPZ v4, SH of 8 bits", "SOG", "compressed PLY"} and len(rows) == 7
    ours = [row.figures for row in rows if row.way == OURS]
    assert [row.setting["qp"] for row in rows if row.way == OURS] == [-30.0, -12.0, 6.0]
    assert ours[0]["bytes"] > ours[1]["bytes"] > ours[2]["bytes"]
    assert ours[0]["psnr_decoded_raw"] > ours[1]["psnr_decoded_raw"] > ours[2]["psnr_decoded_raw"]
    beside = [row.figures for row in rows if "bytes_ours" in row.figures]
    assert beside and all(ours[2]["bytes"] <= figures["bytes_ours"] <= ours[0]["bytes"] for figures in beside)
    text = FREE.tables["free"](rows)
    assert "ours at that dB" in text and "%" in text and text.count("| SOG") == 1
    assert FREE.plots["free"](tmp_path / "free.png", rows) and (tmp_path / "free.png").stat().st_size > 1000


def test_a_format_beyond_our_curve_has_a_dash() -> None:
    rows = [Row("free", "s", "SPZ v4", {"qp": 0.0}, {"bytes": 10, "bytes_each": 1.0, "psnr_decoded_raw": 99.0})]
    assert FREE.tables["free"](rows).splitlines()[-1].endswith("– |")


def test_free_takes_files_without_cameras() -> None:
    assert "free" in TAKE_PATHS
