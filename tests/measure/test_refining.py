"""Refinement by size: what files of at most a size reach, unrefined and refined."""

from __future__ import annotations

from pathlib import Path

from measure.tiny_runs import cells

from tinysplat.measure.rows import Row
from tinysplat.measure.studies.refining import CURVES, curve_plot, curve_table


def test_a_size_is_compared_where_both_kinds_of_file_reach_it(tmp_path: Path) -> None:
    rows = [
        Row(CURVES, "plane 0,1,3,4", way, {"qp": qp, "scene": "plane"}, {"bytes": size, "psnr": psnr})
        for way, qp, size, psnr in (
            ("unrefined", 0.0, 100e3, 27.0),
            ("unrefined", 24.0, 20e3, 25.0),
            ("refined", 0.0, 160e3, 28.0),
            ("refined", 24.0, 40e3, 26.0),
        )
    ]
    found = cells(curve_table(rows))
    windows, before, after, gain, least = found["40"]
    assert (windows, after) == ("1", "26.00") and 25 < float(before) < 26 and gain == least and "20" not in found
    assert curve_plot(tmp_path / "plot.png", rows) and (tmp_path / "plot.png").stat().st_size > 1000
    assert curve_table([]) == ""
