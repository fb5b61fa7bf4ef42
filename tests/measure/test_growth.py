"""What the study of growth measures: its points, what each way does at one, and what tables say of rows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import tinysplat_runtime as ts
from tinysplat.measure.clock import Effort, Peak
from tinysplat.measure.rows import Row, RowFile
from tinysplat.measure.studies import growth
from tinysplat.measure.studies.growth import Point, photo_line, point_table, points, slope_table
from tinysplat.measure.study import Run
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.scene.images import read_image

SQUARES = [(64, 64), (128, 128), (256, 256), (512, 512), (540, 960)]
PICTURES = [*SQUARES[:4], (1080, 1920), (2160, 3840)]
SIDES = [64, 128, 256, 512, 724]


def shown(task: str, quick: bool) -> list[tuple]:
    return [(p.axis, p.size, p.picture, p.factor, p.x) for p in points(task, quick)]


@pytest.mark.parametrize("quick", [False, True])
def test_every_task_has_its_axes(quick: bool) -> None:
    side, most = (64, 3) if quick else (256, 9)
    pixels = [("pixels", f"2x{h}x{w}", (h, w), 1.0, h * w) for h, w in SQUARES[:most]]
    counts = [("Gaussians", f"2x{n}x{n}", (256, 256), 1.0, 2 * n * n) for n in SIDES[:most]]
    for task, views in (("network", (2, 3, 4, 5, 6)), ("encode", (1, 2, 4, 8, 16)), ("decode", (1, 2, 4, 8, 16))):
        along = [("views", f"{n}x{side}x{side}", (side, side), 1.0, n) for n in views[:most]]
        assert shown(task, quick) == along + pixels
    along = [("views", f"{n}x{side}x{side}", (side, side), 1.0, n) for n in (1, 2, 4, 8, 16)[:most]]
    assert shown("render", quick) == along + pixels + counts
    drawn = [("pixels of the picture", "2x256x256", (h, w), 1.0, h * w) for h, w in PICTURES[:most]]
    sizes = [("size of Gaussians", "2x256x256", (256, 256), 2.0**n, 2.0**n) for n in range(5)[:most]]
    assert shown("frame", quick) == drawn + counts + sizes


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return Run(True, Runtime(threads=1), RowFile(tmp_path / "rows.jsonl"), tmp_path, models=["sweep"])


def test_ways_do_what_they_say_at_a_point(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple] = []
    monkeypatch.setattr(growth, "measure_peak", lambda *given: asked.append(given) or Peak(7, 3))
    point = Point("pixels", 2, 16, 24, (20, 28))
    for make, names in (
        (growth._network, ("predict", tmp_path, "sweep", 1)),
        (growth._encode, ("encode", tmp_path / "g.npz", "balanced", 1)),
        (growth._decode, ("decode", tmp_path / "f.tsplat", 1)),
        (growth._render, ("render_once", tmp_path / "g.npz", "20x28", "numpy", 1)),
    ):
        work, peak = make(point, run, "")
        found = work()
        assert peak(tmp_path) == 7 and asked[-1] == (f"tinysplat.measure.tasks.{names[0]}", *names[1:])
        if make is growth._render:
            assert found.shape == (20, 28, 3)
        elif make is growth._encode:
            assert ts.inspect(found)["gaussians"] == 2 * 16 * 24 and ts.inspect(found)["sh_degree"] <= 3
        else:
            assert found.opacities.shape == (2, 16, 24)
    frames = [growth._frame(Point("size", 2, 16, 24, (16, 24), factor), run, "numpy")[0]() for factor in (1, 4)]
    assert frames[0].shape == (16, 24, 3) and np.abs(frames[0] - frames[1]).max() > 0.05
    assert growth._frame(point, run, "numpy")[1](tmp_path) == 0


def test_rows_of_an_axis_have_peaks_where_they_are_wanted(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Run, "effort", Effort(1, least=1))
    members = [Point("pixels", 2, 8, 8, (9, 10), 2.0)]

    def rows(study: str, axis: str) -> list[Row]:
        return list(growth._axis_rows(run, study, axis, members, lambda point: (lambda: None, lambda folder: 5)))

    for study, axis, quick, peaks in (
        ("growth encode", "pixels", True, True), ("growth encode", "views", True, False),
        ("growth encode", "views", False, True), ("growth frame, numpy", "pixels", False, False),
    ):  # fmt: skip
        run.quick = quick
        (found,) = rows(study, axis)
        assert (found.study, found.subject, found.way) == (study, axis, "2x8x8 at 9×10, × 2")
        assert found.setting["x"] == 64 and ("peak_bytes" in found.costs) is peaks
        assert not peaks or found.costs["peak_bytes"] == 5


def test_the_pair_is_written_as_a_scene_and_coded_and_drawn_stage_by_stage(tmp_path: Path) -> None:
    growth._write_pair(tmp_path, (48, 64))
    scene = ts.load_scene(tmp_path)
    assert (scene.near, scene.far, len(scene.frames)) == (2.0, 5.1, 2)
    assert read_image(tmp_path / "1.png").shape == (48, 64, 3)
    growth.encode_photos(str(tmp_path), "1")()
    stages = json.loads((tmp_path / growth.STAGES_FILE).read_text())
    assert {"network", "x265", "write"} <= set(stages)
    assert all(costs["seconds"] >= 0 and costs["peak_bytes"] > 1e7 for costs in stages.values())
    growth.render_photos(str(tmp_path), "1")()
    stages = json.loads((tmp_path / growth.STAGES_FILE).read_text())
    assert {"parse", "libavcodec", "synthesis", "render", "write"} <= set(stages)
    assert all(set(costs) == {"seconds"} for costs in stages.values())
    assert read_image(tmp_path / "picture.png").shape == (48, 64, 3)


def row(study: str, axis: str, x: float, seconds: float, way: str = "w", **costs: float) -> Row:
    return Row(study, axis, way, {"x": x}, {}, {"seconds": seconds, **costs})


def test_tables_have_a_line_a_task_and_axis_and_a_slope_a_cost() -> None:
    rows = [
        row("growth a", "views", 1, 0.5, peak_bytes=2e6, cpu=1.0), row("growth a", "views", 2, 1.0, cpu=4.0),
        row("growth b, numpy", "pixels", 1000, 3e-5), Row("growth a", "views", "w", note="no"), row("other", "x", 1, 1),
    ]  # fmt: skip
    lines = [line.strip("|").split("|") for line in point_table(rows).splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line] for line in lines]
    assert cells[0] == ["", "axis", "points", "seconds", "peak memory"]
    assert cells[2:] == [
        ["a", "views", "1, 2", "500.0 ms, 1.00 s", "2 MB"],
        ["b, numpy", "pixels", "1,000", "30 µs", ""],
    ]
    slopes = [[cell.strip() for cell in line.strip("|").split("|")] for line in slope_table(rows).splitlines()[2:]]
    assert [line[:4] for line in slopes] == [["a", "views", "seconds", "1.00"], ["a", "views", "CPU seconds", "2.00"]]
    assert slopes[0][4] == "in proportion over the whole range (0 µs + 500.0 ms for every view)"
    assert slope_table(rows[:1]) == point_table([]) == slope_table([]) == ""


def test_the_largest_photos_are_told_in_a_sentence() -> None:
    rows = [
        row("growth photos, encode", "pixels", 20, 2.0, "2x4x5", peak_bytes=3e6),
        row("growth photos, encode", "pixels", 6, 1.0, "2x2x3", peak_bytes=1e6),
        row("growth photos, encode: network", "pixels", 20, 9.0, "2x4x5"),
    ]
    assert photo_line(rows) == "Two photos of 5×4, all pixels kept: a file 2.00 s and 3 MB."
    drawn = row("growth photos, render", "pixels", 20, 0.5, "2x4x5", peak_bytes=4e6)
    both = "Two photos of 5×4, all pixels kept: a file 2.00 s and 3 MB, a picture of it 500.0 ms and 4 MB."
    assert photo_line([*rows, drawn]) == both and photo_line([]) == ""


def test_plots_have_a_row_a_cost_and_a_panel_an_axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[tuple] = []
    monkeypatch.setattr(growth, "save_grid", lambda *given: drawn.append(given))
    rows = [
        row("growth a", "views", 1, 0.5, peak_bytes=2e6), row("growth a", "views", 2, 1.0),
        row("growth b", "pixels", 9, 3.0), row("growth plane", "pixels", 9, 3.0),
    ]  # fmt: skip
    assert growth.plot_growth(tmp_path / "p.png", rows) and not growth.plot_growth(tmp_path / "p.png", rows[3:])
    ((path, title, grid),) = drawn
    assert (path.name, title) == ("p.png", "Growth")
    assert [[(p.title, p.x_label, p.y_label, p.log) for p in line] for line in grid] == [
        [("views", "views", "seconds", "xy"), ("pixels", "pixels", "seconds", "xy")],
        [("views", "views", "peak memory, MB", "xy")],
    ]
    found = [[(c.name, list(c.points), c.slope_one) for c in p.curves] for line in grid for p in line]
    assert found == [[("a", [(1, 0.5), (2, 1.0)], True)], [("b", [(9, 3.0)], True)], [("a", [(1, 2.0)], False)]]
