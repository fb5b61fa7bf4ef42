"""Evaluations find what there is to measure, measure it once, and lose neither a window nor a reason."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from datasets.chunks import make_chunk_scene, write_chunks
from measure.evaluation_scenes import (
    HEIGHT,
    NEAR_WINDOW,
    WIDE_WINDOW,
    WIDTH,
    plane_photo,
    write_eval_scene,
    write_index,
)
from measure.tiny_runs import shows
from scenes import refusing, tells

from tinysplat.measure.metrics import psnr
from tinysplat.measure.quality import GROUP, ProfileQp, Quality, mean_of_rows, mean_of_scenes, record
from tinysplat.measure.rows import ROWS, Row, RowFile, grouped, read_rows
from tinysplat.measure.runner import RunOutcome, RunPlan, document, list_jobs, run_jobs
from tinysplat.measure.show.quality import TABLES
from tinysplat.measure.subjects.cases import Window, covered_pixels
from tinysplat.measure.subjects.sources import FolderSource, find_sources
from tinysplat_runtime.errors import InputError

SIZE = (HEIGHT, WIDTH)
CODINGS = (ProfileQp("paper", 0.0), ProfileQp("balanced", 6.0))


def plan_of(*paths: Path, **options) -> RunPlan:
    sources, left_out = find_sources(paths)
    assert not left_out
    return RunPlan(sources, ("sweep",), **{"size": SIZE, **options})


def evaluate(plan: RunPlan, folder: Path, codings=CODINGS, **options) -> RunOutcome:
    return run_jobs(plan, Quality(codings, **options), RowFile(folder / ROWS))


def figures(row: Row) -> dict:
    """All of a row that two runs must agree on."""
    return {**row.setting, **row.figures}


# ---- finding windows ---------------------------------------------------------------------------------------------


def test_a_folder_of_scenes_gives_its_scenes_by_name(tmp_path):
    for name in "ba":
        write_eval_scene(tmp_path / name)
    (tmp_path / "other").mkdir()
    sources, left_out = find_sources([tmp_path])
    assert [source.name for source in sources] == ["a", "b"] and not left_out


def test_windows_at_fault_are_left_out_one_by_one(tmp_path):
    faults = [
        ({"context": [0, 1], "target": [4]}, "windows[1].target 4 0 3"),
        ({"context": [0, 9], "target": [1]}, "windows[2].context 9 0 3"),
        ({"context": [0, 1], "target": []}, "windows[3].target"),
        ({"context": [0, 1]}, "windows[4].target"),
        ({"context": [0, 0], "target": [1]}, "windows[5].context [0, 0]"),
        ({"kind": "../x", "context": [0, 1], "target": [2]}, "windows[6].kind '../x'"),
        ("window", "windows[7]"),
    ]
    source = FolderSource(write_eval_scene(tmp_path / "a", [NEAR_WINDOW, *(entry for entry, _ in faults)]))
    windows, left_out = source.windows()
    assert windows == [Window("near", (0, 2), (1,))]
    for entry, (_, said) in zip(left_out, faults, strict=True):
        assert entry.where.startswith("a ") and tells(entry.why, said)


@pytest.mark.parametrize("text", ["{", "[]", '{"windows": []}', '{"windows": 3}', "{}"])
def test_an_index_without_windows_loses_its_scene_alone(tmp_path, text):
    write_eval_scene(tmp_path / "a")
    write_eval_scene(tmp_path / "b")
    (tmp_path / "a" / "eval_index.json").write_text(text)
    jobs, left_out, notes = list_jobs(plan_of(tmp_path))
    assert [job.source.name for job in jobs] == ["b"] and not notes
    assert len(left_out) == 1 and left_out[0].where == "a" and "eval_index.json" in left_out[0].why


def test_paths_that_lead_to_no_source_are_named(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").touch()
    write_chunks(tmp_path / "chunks", [[make_chunk_scene("k", 1, 36, 64)]])
    paths = [tmp_path / name for name in ("missing", "empty", "notes.txt", "chunks")]
    sources, left_out = find_sources(paths)
    assert not sources
    assert [Path(entry.where) for entry in left_out] == paths
    assert "cameras.json" in left_out[1].why and "'.txt'" in left_out[2].why and "--index" in left_out[3].why


def test_the_depth_range_is_the_options_then_the_indexs_then_the_cameras(tmp_path):
    folder = write_eval_scene(tmp_path / "a")
    assert FolderSource(folder).scene().depth_range() == (2, 8)
    assert FolderSource(folder, near=1.5).scene().depth_range() == (1.5, 8)
    index = json.loads((folder / "eval_index.json").read_text())
    (folder / "eval_index.json").write_text(json.dumps({"windows": index["windows"]}))
    assert FolderSource(folder).scene().depth_range() == (1, 30)
    (folder / "eval_index.json").write_text(json.dumps({**index, "near": -1}))
    with refusing(InputError, "eval_index.json near -1"):
        FolderSource(folder).scene()


# ---- measuring ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measured(tmp_path_factory) -> tuple[Path, RunOutcome]:
    """A scene and its results."""
    folder = tmp_path_factory.mktemp("measured")
    scene = write_eval_scene(folder / "plane", [NEAR_WINDOW, WIDE_WINDOW])
    return scene, evaluate(plan_of(scene), folder / "results")


def test_figures_are_means_over_images_of_what_the_pictures_show(measured):
    scene, outcome = measured
    wanted = [(kind, coding.profile, coding.qp) for kind in ("near", "wide") for coding in CODINGS]
    assert [tuple(row.setting[name] for name in ("kind", "profile", "qp")) for row in outcome.rows] == wanted
    entry = record(outcome.rows[2])
    assert entry["context"] == [0, 3] and entry["targets"] == [1, 2] and entry["views"] == 2
    assert (entry["height"], entry["width"]) == SIZE
    photos = [plane_photo(0.2 * i).astype(np.float32) / 255 for i in entry["targets"]]
    nearest = [plane_photo(0.2 * i).astype(np.float32) / 255 for i in (0, 3)]
    expected = np.mean([psnr(a, b) for a, b in zip(nearest, photos, strict=True)])
    assert entry["psnr_photo"] == pytest.approx(expected, abs=1e-6)
    views = FolderSource(scene).scene().resized(*SIZE).views((0, 1, 2, 3)).cameras
    shares = [covered_pixels(views[i], [views[0], views[3]], 2.0, 8.0).mean() for i in (1, 2)]
    assert entry["coverage"] == pytest.approx(np.mean(shares), abs=1e-9)


def test_a_row_says_what_coding_cost(measured):
    _, outcome = measured
    fine, coarse = (record(row) for row in outcome.rows[:2])
    assert fine["bytes"] == sum(fine["bytes_by_class"].values()) + fine["metadata_bytes"] > coarse["bytes"]
    assert fine["psnr_decoded_raw"] > coarse["psnr_decoded_raw"]
    assert fine["psnr_raw"] == coarse["psnr_raw"] and fine["psnr_photo"] < fine["psnr_raw"]
    assert 0 < fine["coverage"] <= 1 and fine["psnr_covered"] is not None
    assert {"network", "render"} < set(fine["seconds"]) and min(fine["seconds"].values()) >= 0
    assert fine["attribute_errors"]["means"]["rmse"] < coarse["attribute_errors"]["means"]["rmse"]
    assert fine["lpips"] is None and fine["lpips_raw"] is None


def test_a_run_cut_short_or_torn_goes_on_to_the_same_figures(measured, tmp_path):
    scene, outcome = measured
    first = evaluate(plan_of(scene, limit=1), tmp_path, CODINGS[:1])
    with (tmp_path / ROWS).open("a") as file:
        file.write('{"study": "quality", "subj')
    rest = evaluate(plan_of(scene), tmp_path)
    assert rest.resumed == 1 and rest.rows[0] == first.rows[0]
    assert list(map(figures, rest.rows)) == list(map(figures, outcome.rows))
    assert list(RowFile(tmp_path / ROWS)) == read_rows(tmp_path) == rest.rows
    (tmp_path / ROWS).write_text('{"study": 1, "other": 2}\n')
    with refusing(InputError, "rows.jsonl line 1"):
        RowFile(tmp_path / ROWS)


def test_rows_of_other_photos_cameras_or_options_are_not_taken_for_these(tmp_path):
    scene = write_eval_scene(tmp_path / "a")

    def is_new() -> bool:
        return evaluate(plan_of(scene), tmp_path / "results", CODINGS[1:]).resumed == 0

    assert is_new() and not is_new()

    os.utime(scene / "3.png", ns=(1, 1))
    assert not is_new()  # a photo that the window does not use
    os.utime(scene / "1.png", ns=(1, 1))
    assert is_new()
    write_index(scene, [{**NEAR_WINDOW, "target": [1, 3]}])
    assert is_new()


# ---- condensing --------------------------------------------------------------------------------------------------


def changed(row: Row, scene: str, psnr: float) -> Row:
    return replace(row, setting={**row.setting, "scene": scene}, figures={**row.figures, "psnr": psnr})


def test_scenes_weigh_the_same_in_the_mean_of_scenes(measured):
    _, outcome = measured
    row = outcome.rows[0]
    rows = [changed(row, "a", 30.0), changed(row, "other", 10.0), changed(row, "other", 20.0)]
    (members,) = grouped(rows, *GROUP).values()
    assert mean_of_rows(members)["psnr"] == 20
    assert mean_of_scenes(members)["psnr"] == 22.5
    assert shows(TABLES["quality summary"](rows), 22.5)


def test_the_json_document_has_the_keys_that_scripts_rely_on(measured):
    _, outcome = measured
    found = json.loads(json.dumps(document(outcome, "none", 1, 1), allow_nan=False))
    keys = {"scene", "kind", "model", "profile", "qp", "height", "width", "views", "context", "targets", "psnr_raw",
            "psnr", "psnr_decoded_raw", "ssim", "ssim_raw", "lpips", "bytes", "seconds"}  # fmt: skip
    assert all(keys <= set(entry) for entry in found["scenes"])
    assert found["mean"]["psnr"] == pytest.approx(np.mean([entry["psnr"] for entry in found["scenes"]]))
    assert len(found["groups"]) == 4 and found["groups"][0]["mean"]["bytes"] == found["scenes"][0]["bytes"]
