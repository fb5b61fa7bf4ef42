"""`bench free`: points of files of no pixels, ours over Q_g and the others beside them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measure.tiny_runs import tiny_run
from scenes import make_free_gaussians

import tinysplat_runtime as ts
from tinysplat.commands.bench import TAKE_PATHS
from tinysplat.measure.rows import Row
from tinysplat.measure.studies.freed import FREE, OURS, UNFITTED, WHOLE, free_rows
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.scene.images import write_png
from tinysplat_runtime.scene.intake.cameras_json import camera_entry

pytest.importorskip("plyfile")
pytest.importorskip("PIL")
pytest.importorskip("numba")

from tinysplat_runtime.prune import views


def test_every_format_has_its_points_and_what_ours_takes_at_the_same_decibels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "scene.ply"
    ts.save_gaussians(scene, make_free_gaussians(500, 1, np.random.default_rng(2)))
    monkeypatch.setattr(views, "SIDE", 96)
    run = tiny_run(tmp_path / "report")
    run.paths, run.options = [scene, tmp_path / "none.ply"], replace(run.options, qps=(-30.0, -12.0, 6.0))
    rows = list(free_rows(run))
    assert len(run.left_out) == 1 and "none.ply" in run.left_out[0]
    ways = {row.way for row in rows}
    assert ways == {OURS, WHOLE, UNFITTED, "SPZ v4", "SPZ v4, SH of 8 bits", "SOG", "compressed PLY"}
    assert len(rows) == 11
    ours = [row.figures for row in rows if row.way == OURS]
    whole, unfitted = ([row.figures for row in rows if row.way == way] for way in (WHOLE, UNFITTED))
    assert [figures["kept"] for figures in whole] == [500] * 3 and whole[2]["bytes"] > ours[2]["bytes"]
    assert [row.way for row in rows if row.costs][:3] == [OURS, WHOLE, UNFITTED]
    assert [row.setting["qp"] for row in rows if row.way == OURS] == [-30.0, -12.0, 6.0]
    assert ours[0]["bytes"] > ours[1]["bytes"] > ours[2]["bytes"]
    assert ours[0]["psnr_decoded_raw"] > ours[1]["psnr_decoded_raw"] > ours[2]["psnr_decoded_raw"]
    assert [figures["kept"] for figures in unfitted] == [ours[0]["kept"]]
    assert ours[2]["kept"] < ours[0]["kept"] <= 500
    beside = [row.figures for row in rows if "bytes_ours" in row.figures]
    assert beside and all(ours[2]["bytes"] <= figures["bytes_ours"] <= ours[0]["bytes"] for figures in beside)
    text = FREE.tables["free"](rows)
    assert "ours at that dB" in text and "%" in text and text.count("| SOG") == 1
    assert FREE.plots["free"](tmp_path / "free.png", rows) and (tmp_path / "free.png").stat().st_size > 1000


def test_a_format_beyond_our_curve_has_a_dash() -> None:
    rows = [
        Row("free", "s", "SPZ v4", {"qp": 0.0}, {"bytes": 10, "bytes_each": 1.0, "kept": 10, "psnr_decoded_raw": 99.0})
    ]
    assert FREE.tables["free"](rows).splitlines()[-1].split("|")[-3].strip() == "–"


def test_a_folder_behind_a_file_holds_the_photos_that_its_pictures_are_held_against(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gaussians, folder = make_free_gaussians(300, 0, np.random.default_rng(2)), tmp_path / "photos"
    ts.save_gaussians(tmp_path / "scene.ply", gaussians)
    cameras = [camera.resized(48, 48) for camera in ring(gaussians, 5)]
    folder.mkdir()
    renderer = Renderer(gaussians, 1, **DEFINITION)
    for number, camera in enumerate(cameras):
        write_png(folder / f"{number}.png", renderer.render(camera).clip(0, 1))
    frames = [camera_entry(f"{number}.png", camera) for number, camera in enumerate(cameras)]
    (folder / "cameras.json").write_text(json.dumps({"frames": frames}))
    monkeypatch.setattr(views, "SIDE", 64)
    run = tiny_run(tmp_path / "report")
    run.paths, run.options = [tmp_path / "scene.ply", folder], replace(run.options, qps=(-12.0,))
    rows = list(free_rows(run))
    assert not run.left_out and len({row.subject for row in rows}) == 1
    # the photos are the scene's own pictures, to eight bits
    assert all(row.figures["psnr_raw"] > 50 for row in rows)
    assert all(abs(row.figures["psnr"] - row.figures["psnr_decoded_raw"]) < 1 for row in rows if row.way == OURS)


def test_free_takes_files_without_cameras() -> None:
    assert "free" in TAKE_PATHS
