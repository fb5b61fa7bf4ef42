"""Rate–distortion of whole windows: tables that say what cannot be compared, and studies that go on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from measure.evaluation_scenes import NEAR_WINDOW, write_eval_scene
from measure.tiny_runs import cells, rows_of, tiny_run
from scenes import make_smooth_gaussians

from tinysplat.measure.rows import Row
from tinysplat.measure.show.curve_tables import gain_table, photo_table, rate_table
from tinysplat.measure.studies import find_study
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import save_gaussians

DECIBELS = (36.0, 38.0, 40.0, 42.0)
CLASSES = {"depth": 100, "offset": 20, "scale": 0, "rotation": 0, "color": 240, "opacity": 40, "metadata": 9}


def _rows(
    way: str, factor: float, case: str = "fox near 2,5", decibels=DECIBELS, photo: float | None = 25.0, study="curves"
):
    """A curve whose bytes double every 2 dB; it loses a 10th of its error to the photo."""
    rows = []
    for n, db in enumerate(decibels):
        figures = {"bytes": round(factor * 10_000 * 2 ** ((db - 36) / 2)), "psnr_decoded_raw": db, "classes": CLASSES}
        figures |= {} if photo is None else {"psnr": photo - (42 - db) / 10, "psnr_raw": photo}
        setting = {"network": "edge", "views": 2, "qp": n}
        rows.append(Row(study, case, way, setting, figures))
    return rows


def test_half_the_bytes_are_half_in_every_column():
    found = cells(rate_table([*_rows("paper", 1), *_rows("half", 0.5)]))
    assert found["half"][:3] == ["36.0–42.0", "10.0 (50%)", "14.1 (50%)"]
    assert found["half"][-2:] == ["-50.0%", "-50.0%"]
    lost = cells(photo_table([*_rows("paper", 1), *_rows("half", 0.5)]))["half"]
    assert lost[1:] == ["7.1 (50%)", "20.0 (50%)", "28.3 (50%)", "-50.0%"]


def test_shares_are_means_over_windows_in_proportion():
    rows = [*_rows("paper", 1), *_rows("x", 0.5), *_rows("paper", 2, "trex"), *_rows("x", 4, "trex")]
    found = cells(rate_table(rows))["x"]
    assert found[-1] == "+0.0% (-50% to +100%)" and "(100%)" in found[1]


def test_what_an_idea_gains_is_what_the_codec_without_it_costs():
    whole = _rows("balanced", 1, study="ideas")
    rows = [*whole, *_rows("depth as z", 1.1, study="ideas")]
    rows += [replace(row, setting={**row.setting, "views": 4}) for row in whole]
    assert cells(gain_table(rows))["depth as z"] == ["+10.0% (+10% to +10%)", "–"]
    coarse = [*whole, *_rows("k ≤ 1", 1, decibels=(30.0,), study="ideas")]
    assert cells(gain_table(coarse))["k ≤ 1"] == ["1 KB at 30.0 dB"]


# ---- studies -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> tuple[Path, Path]:
    """A scene and a Gaussian file."""
    folder = tmp_path_factory.mktemp("curves")
    save_gaussians(folder / "made.npz", make_smooth_gaussians(height=24, width=32, degree=2, layers=2))
    return write_eval_scene(folder / "plane", [NEAR_WINDOW]), folder / "made.npz"


def test_curves_cover_profiles_modes_and_peers_and_go_on(inputs, tmp_path):
    options = {"models": ("sweep",), "profiles": ("fast",), "modes": ("photos",), "peers": ("spz",), "qps": (0.0, 8.0)}
    run = tiny_run(tmp_path, *inputs, **options)
    rows = rows_of("curves", run)
    assert {row.way for row in rows if row.setting["network"] == "sweep"} == {"fast", "photos", "SPZ"}
    of_file = [row for row in rows if row.setting["network"] == "file"]
    assert {row.note for row in of_file if not row.figures} == {"it needs the photos of a scene"}
    assert all(("psnr" in row.figures) == (row.setting["network"] == "sweep") for row in rows if row.figures)
    text = "\n".join(table(rows) for table in find_study("curves").tables.values())
    assert "### sweep, 2 views: plane near 0,2" in text and "### file, 2 views" in text
    assert all(plot(tmp_path / "p.png", rows) for plot in find_study("curves").plots.values())
    size = (tmp_path / "rows.jsonl").stat().st_size
    assert rows_of("curves", tiny_run(tmp_path, *inputs, **options)) == rows
    assert (tmp_path / "rows.jsonl").stat().st_size == size


def test_bad_input_costs_a_line(inputs, tmp_path):
    with pytest.raises(InputError, match="needs scene folders or Gaussian files"):
        rows_of("curves", tiny_run(tmp_path))
    with pytest.raises(InputError, match="accepted are photos, hybrid"):
        rows_of("curves", tiny_run(tmp_path, inputs[1], modes=("video",)))
    assert rows_of("curves", tiny_run(tmp_path, inputs[1], views=(6,))) == []
