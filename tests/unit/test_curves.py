"""Rate–distortion of whole windows: rows that survive a kill, tables that say what cannot be compared, the script."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from evaluation_scenes import NEAR_WINDOW, write_eval_scene
from PIL import Image
from scenes import make_smooth_gaussians

from benchmarks import rate_distortion as script
from tinysplat.evaluation import ideas
from tinysplat.evaluation.curve_rows import Row, RowFile, csv_of, read_rows
from tinysplat.evaluation.curve_tables import (
    bits_table,
    gain_table,
    overview_table,
    photo_table,
    rate_table,
    single_table,
)
from tinysplat.evaluation.rate_distortion import Point
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import save_gaussians

DECIBELS = (36.0, 38.0, 40.0, 42.0)


def _rows(way: str, factor: float, case: str = "fox near 2,5", decibels=DECIBELS, photo: float | None = 25.0):
    """A curve whose bytes double every 2 dB; it loses a 10th of its error to the photo."""
    return [
        Row(
            "edge", 2, case, way,
            Point(n, round(factor * 10_000 * 2 ** ((db - 36) / 2)), db, photo and photo - (42 - db) / 10,
                  {"depth": 100, "offset": 20, "scale": 0, "rotation": 0, "color": 240, "opacity": 40, "metadata": 9}),
            photo, "s",
        )
        for n, db in enumerate(decibels)
    ]  # fmt: skip


def _cells(table: str) -> dict[str, list[str]]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"]
    return {line[0]: line[1:] for line in lines}


# ---- rows --------------------------------------------------------------------------------------------------------


def test_rows_survive_the_file(tmp_path):
    rows = [*_rows("paper", 1), *_rows("SPZ", 9, photo=None)[:1]]
    (tmp_path / "points.csv").write_text(csv_of(rows))
    assert read_rows(tmp_path / "points.csv") == rows


def test_a_row_is_taken_over_only_with_its_own_stamp(tmp_path):
    file, (row, *_) = RowFile(tmp_path / "points.csv"), _rows("paper", 1)
    file.add(row)
    again = RowFile(tmp_path / "points.csv")
    assert again.find(row.key, "s") == row and again.find(row.key, "other") is None
    again.add(replace(row, stamp="other"))
    assert [r.stamp for r in read_rows(tmp_path / "points.csv")] == ["other"]


def test_a_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "points.csv").write_text("network,views\nedge,two\n")
    with pytest.raises(InputError, match="line 2: not a row of curves"):
        RowFile(tmp_path / "points.csv")


# ---- tables ------------------------------------------------------------------------------------------------------


def test_half_the_bytes_are_half_in_every_column():
    cells = _cells(rate_table([*_rows("paper", 1), *_rows("half", 0.5)]))
    assert cells["half"][:3] == ["36.0–42.0", "10.0 (50%)", "14.1 (50%)"]
    assert cells["half"][-2:] == ["-50.0%", "-50.0%"]
    lost = _cells(photo_table([*_rows("paper", 1), *_rows("half", 0.5)]))["half"]
    assert lost[1:] == ["7.1 (50%)", "20.0 (50%)", "28.3 (50%)", "-50.0%"]


def test_shares_are_means_over_windows_in_proportion():
    rows = [*_rows("paper", 1), *_rows("x", 0.5), *_rows("paper", 2, "trex"), *_rows("x", 4, "trex")]
    cells = _cells(rate_table(rows))["x"]
    assert cells[-1] == "+0.0% (-50% to +100%)" and "(100%)" in cells[1]


def test_the_overview_has_every_curve_and_no_points():
    rows = [*_rows("paper", 1), *_rows("half", 0.5), *_rows("SPZ", 9, decibels=(41.0,))]
    lines = overview_table(rows).splitlines()
    assert "SPZ" not in lines[0] and " -50.0% |" in lines[2] and " 14.1 (50%) |" in lines[3]


def test_curves_that_do_not_meet_say_so():
    rows = [*_rows("paper", 1), *_rows("x", 0.5, decibels=(44.0, 46.0)), *_rows("SPZ", 9, decibels=(41.0,))]
    cells = _cells(rate_table(rows))
    assert cells["x"][1:] == ["–"] * 4 + ["curves share 0.00 dB"] * 2
    assert cells["SPZ"][-1] == "a curve of one point"
    assert _cells(single_table(rows))["SPZ"] == ["509.1", "41.00", "9.00 ×"]
    beyond = single_table([*_rows("paper", 1), *_rows("SPZ", 9, decibels=(60.0,))])
    assert "beyond its curve: 4608.00 × its 42.0 dB" in beyond
    assert single_table(_rows("paper", 1)) == "" and photo_table(_rows("paper", 1, photo=None)) == ""


def test_windows_that_lack_a_size_are_counted():
    rows = [*_rows("paper", 1), *_rows("x", 0.5), *_rows("paper", 1, "trex"), *_rows("x", 1, "trex", (44.0, 46.0))]
    cells = _cells(rate_table(rows))["x"]
    assert cells[1] == "10.0 (50%), 1 of 2" and cells[-1] == "-50.0%, 1 of 2"


def test_bits_are_shares_of_the_planes_below_the_printed_ones():
    table = bits_table(_rows("paper", 1))
    assert _cells(table)["paper"][4:] == ["30.0", "0.0", "0.0", "60.0", "10.0", "–"] and "164.6" in table


def test_what_an_idea_gains_is_what_the_codec_without_it_costs():
    rows = [*_rows("balanced", 1), *_rows("depth as z", 1.1), *(replace(r, views=4) for r in _rows("balanced", 1))]
    assert _cells(gain_table(rows))["depth as z"] == ["+10.0% (+10% to +10%)", "–"]
    coarse = [*_rows("balanced", 1), *_rows("k ≤ 1", 1, decibels=(30.0,))]
    assert _cells(gain_table(coarse))["k ≤ 1"] == ["1 KB at 30.0 dB"]


# ---- the script --------------------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run benchmarks/rate_distortion.py; returns what it printed and its folder."""

    def call(*arguments: object, status: int = 0) -> tuple[str, str, Path]:
        options = [*arguments, "-o", tmp_path / "out", "--threads", 1, "--size", "48x64", "--quick"]
        monkeypatch.setattr(sys, "argv", ["rate_distortion.py", *map(str, options)])
        assert script.main() == status
        return *capsys.readouterr(), tmp_path / "out"

    return call


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    return write_eval_scene(tmp_path_factory.mktemp("curves") / "plane", [NEAR_WINDOW])


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("curves") / "made.npz"
    save_gaussians(path, make_smooth_gaussians(height=24, width=32, degree=2, layers=2))
    return path


def test_curves_cover_profiles_modes_and_peers_and_go_on(run, scene, file):
    options = ["curves", scene, file, "--model", "sweep", "--profiles", "paper,fast", "--modes", "photos,hybrid",
               "--peers", "spz", "--views", "2"]  # fmt: skip
    text, said, folder = run(*options)
    assert "## sweep, 2 views: plane near 0,2" in text and "## file, 2 views" in text
    assert "no photos, a Gaussian file has no photos" in said
    rows = read_rows(folder / "points.csv")
    assert {row.way for row in rows if row.network == "sweep"} == {"paper", "fast", "photos", "hybrid", "SPZ"}
    assert all((row.point.to_photo is None) == (row.network == "file") for row in rows)
    for network in ("sweep", "file"):
        with Image.open(folder / f"curves-{network}.png") as image:
            assert image.width > 300
    again, said, _ = run(*options)
    assert again == text and " dB" not in said
    assert run("curves")[0] == text


def test_an_ablation_undoes_every_idea_and_tells_its_cost(run, file):
    text, _, folder = run("ablation", file, "--rounds", 1)
    names = {*ideas.CHANGES, ideas.STEPS_NOT_MEASURED}
    assert {row.way for row in read_rows(folder / "points.csv")} == {"balanced", *names, *ideas.other_settings()}
    gains, costs = text.split("CPU milliseconds of the idea")
    assert all(f"| {name} " in gains and f"| {name} " in costs for name in names)


def test_seconds_stand_beside_decibels(run, file):
    text, _, folder = run("seconds", file, "--profiles", "paper,fast", "--qps=0", "--rounds", 1)
    entries = json.loads((folder / "seconds.json").read_text())
    assert [entry["way"] for entry in entries] == ["paper", "fast"]
    assert all(e["encode"][1] <= e["encode"][0] <= e["encode"][2] and e["decode"][3] > 0 for e in entries)
    assert "| paper, Q_g 0 |" in text and (folder / "seconds-file.png").is_file()


def test_bad_input_costs_a_line(run, tmp_path, file):
    assert "no such folder" in run("curves", tmp_path / "missing", status=2)[1]
    assert "accepted are photos, hybrid" in run("curves", file, "--modes", "video", status=2)[1]
    assert "no window to measure" in run("curves", file, "--views", "6", status=2)[1]


def test_functions_whose_time_an_idea_costs_are_called(file):
    from tinysplat.bench.way_seconds import work_seconds
    from tinysplat_runtime.api import Runtime
    from tinysplat_runtime.formats.table import load_gaussians

    spent = work_seconds(load_gaussians(file), 0.0, Runtime(threads=1))
    assert set(spent) == set(ideas.WORK) and all(seconds > 0 for seconds in spent.values())
