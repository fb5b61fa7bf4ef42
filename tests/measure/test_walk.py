"""`bench walk`: photos left out of a capture, drawn at the size of a screen, judged by more than dB."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from measure.evaluation_scenes import write_eval_scene
from measure.tiny_runs import rows_of, shows, tiny_run

from tinysplat.measure.metrics import METRICS
from tinysplat.measure.studies import find_study

pytest.importorskip("PIL")


def test_pictures_are_judged_at_the_size_that_they_are_drawn_at(tmp_path: Path) -> None:
    run = tiny_run(tmp_path, write_eval_scene(tmp_path / "plane", frames=6))
    run.options = replace(run.options, size=(24, 32), drawn=(48, 64))
    rows = rows_of("walk", run)
    assert run.left_out == [] and {"walk", "own pair", "nearest photo"} <= {row.way for row in rows}
    walks = [row for row in rows if row.study == "walk"]
    assert all({*METRICS, "worst"} <= set(row.figures) and row.setting["drawn"] == "64×48" for row in walks)
    small, table = rows[0].figures, find_study("walk").tables["walk scenes"](rows)
    assert all(shows(table, small[name]) for name in ("coded", "coded_ssim", "coded_sharpness"))


def test_two_pictures_may_have_the_same_nearest_photo(tmp_path: Path) -> None:
    scene = write_eval_scene(tmp_path / "plane", frames=7)
    cameras = json.loads((scene / "cameras.json").read_text())
    cameras["frames"][6]["c2w"] = cameras["frames"][2]["c2w"]  # the photos that are left out
    (scene / "cameras.json").write_text(json.dumps(cameras))
    run = tiny_run(tmp_path, scene)
    assert "nearest photo" in {row.way for row in rows_of("walk", run)} and run.left_out == []
