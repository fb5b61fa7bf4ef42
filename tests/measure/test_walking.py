"""The study of captures: which photos are left out, and a row per way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measure.evaluation_scenes import write_eval_scene
from measure.tiny_runs import cells, rows_of, tiny_run
from scenes import make_gaussians

from tinysplat.measure.pictures import Drawing
from tinysplat.measure.studies import find_study, walking
from tinysplat.measure.studies.walking import Capture, flicker
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.scenes import Frame, Scene


def capture_of(count: int) -> Capture:
    camera = Camera([[10, 0, 5], [0, 10, 5], [0, 0, 1]], np.eye(4), 10, 10)
    return Capture.of(Scene(Path("s"), tuple(Frame(camera, Path(f"{i}.png")) for i in range(count)), 1.0, 2.0))


def test_every_fourth_photo_is_left_out_and_the_rest_is_spread() -> None:
    capture = capture_of(50)
    assert len(capture.others) == 38 and capture.targets == (2, 6, 10, 14, 18, 22, 26, 30)
    assert capture_of(65).targets == (2, 10, 18, 26, 34, 42, 50, 58)
    given = [int(frame.path.stem) for frame in capture.given(12).frames]
    assert given[0] == 0 and given[-1] == 49 and len(given) == 12 and not set(given) & set(range(2, 50, 4))
    assert max(np.diff(given)) <= 6 and len(capture.given(99).frames) == 38


def test_a_row_per_way_and_number_of_photos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walking, "QUICK_COUNTS", (8, 12))
    monkeypatch.setattr(walking, "COMPARED", 8)
    scene = write_eval_scene(tmp_path / "plane", frames=13)
    run = tiny_run(tmp_path, scene)
    rows = rows_of("walk", run)
    assert run.left_out == []
    assert [(row.way, row.setting["asked"], row.setting["photos"]) for row in rows] == [
        ("walk", "8", 8),
        ("refined walk", "8", 8),
        ("walk, range stated", "8", 8),
        ("walk", "12", 10),
        ("refined walk", "12", 10),
        ("walk", "all", 10),
        ("refined walk", "all", 10),
        ("six spread", "8", 6),
        ("own pair", "8", 2),
        ("nearest photo", "8", 1),
    ]
    assert (
        rows[3].figures == rows[5].figures
        and rows[1].costs["cpu"] > rows[0].costs["cpu"]
        and rows[0].figures["flicker"] >= 1
    )
    assert all(row.figures["worst"] <= row.figures["psnr"] for row in rows)
    assert rows[0].figures["psnr"] > rows[-1].figures["psnr"] + 3  # a plane is drawn better than shown from beside
    table = cells(find_study("walk").tables["walk"](rows))
    assert (
        table["own pair"][0] == "2"
        and table["walk, all"][0] == "10"
        and table["walk, 8"][0] == "8"
        and float(table["walk, 8"][3]) > 20
    )
    assert rows[0].costs["cpu"] > 0 and len(cells(find_study("walk").tables["walk summary"](rows))["walk, 8"]) == 6


def test_flicker_is_the_largest_change_beside_those_about_it(monkeypatch: pytest.MonkeyPatch) -> None:
    gaussians = make_gaussians(3, 8, 12)
    levels = iter([0, 1, 2, 3, 7, 8, 9, 10, 11, 12, 13, 14, 15])

    class Steps(Drawing):
        def renderer(self, gaussians: object) -> object:  # type: ignore[override]
            return lambda camera: np.full((2, 2, 3), next(levels))

    assert flicker(gaussians, Steps()) == pytest.approx(4.0)
