"""Refinement beside another checkout's: steps in turns by processor time, and seconds to equal gains."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from measure.evaluation_scenes import write_eval_scene
from measure.tiny_runs import cells, rows_of, tiny_run

from tinysplat.measure.rows import Row
from tinysplat.measure.studies import pacing
from tinysplat_runtime.errors import InputError


def row(way: str, step: int, cpu: float, psnr: float, subject: str = "a", views: int = 4) -> Row:
    return Row("paces", subject, way, {"views": views, "size": "8x8", "step": step}, {"psnr": psnr}, {"cpu": cpu})


def test_seconds_lie_on_lines_between_steps() -> None:
    curve = [(1.0, 20.0), (2.0, 22.0), (3.0, 21.0), (5.0, 24.0)]
    assert pacing.seconds_to(curve, 19.0) == pacing.seconds_to(curve, 20.0) == 1
    assert pacing.seconds_to(curve, 21.5) == 1.75
    assert pacing.seconds_to(curve, 23.0) == pytest.approx(3 + 2 * 2 / 3)
    assert pacing.seconds_to(curve, 24.1) is None


def test_ratios_are_of_equal_gains_and_medians_of_windows() -> None:
    rows = [row("this", 0, 1, 20), row("this", 1, 2, 24), row("other", 0, 2, 20), row("other", 1, 10, 22)]
    for number, slow in enumerate((2.0, 4.0)):
        for step, (seconds, psnr) in enumerate(((1.0, 20.0), (2.0, 22.0))):
            rows += [
                row("this", step, seconds, psnr, f"b{number}"),
                row("other", step, slow * seconds, psnr, f"b{number}"),
            ]
    rows += [row("this", 0, 1, 20, "none"), row("other", 0, 2, 20, "none")]  # nothing gained, nothing to compare
    lines = cells(pacing.pace_table(rows))
    assert "none" not in lines
    assert lines["a"] == ["4", "8x8", "20.00 → 22.00", "1.2 / 6.0 = 0.21", "1.4 / 8.0 = 0.17", "1.5 / 10.0 = 0.15"]
    assert lines["median of 3"][3:] == ["**0.25**"] * 3


def test_both_take_the_same_steps_from_the_same_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    monkeypatch.setattr(pacing, "QUICK_STEPS", 1)
    windows = [{"kind": "multi", "context": [0, 1, 3, 4], "target": [2]}]
    run = tiny_run(tmp_path, write_eval_scene(tmp_path / "plane", windows, frames=5))
    with pytest.raises(InputError, match="--beside: missing, expected the checkout"):
        rows_of("paces", run)
    run.options = replace(run.options, beside=pacing.OWN_ROOT, views=(4,))
    rows = rows_of("paces", run)
    found = {(row.way, row.setting["step"]): row for row in rows}
    assert run.left_out == [] and len(rows) == len(found) == 4
    for step in (0, 1):
        assert found["this", step].figures == found["other", step].figures
    assert found["this", 1].figures["psnr"] != found["this", 0].figures["psnr"]
    assert all(found[way, 1].costs["cpu"] > found[way, 0].costs["cpu"] > 0 for way in ("this", "other"))
