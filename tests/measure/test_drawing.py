"""Errors of drawing are those of committed rows, and ways are what their names say."""

from __future__ import annotations

import pytest

from tinysplat.measure.studies import drawing
from tinysplat.measure.subjects.made import made_gaussians


@pytest.mark.parametrize(
    ("count", "side"), [(8192, 64), (131_072, 256), (524_288, 512), (1_048_576, 724), (2, 8), (100, 8)]
)
def test_two_square_views_hold_the_gaussians(count: int, side: int) -> None:
    assert drawing.count_side(count) == side


def test_less_work_loses_more_the_less_it_is() -> None:
    variants = drawing.approximations(made_gaussians(1, 24, 24, 2), 32, 1)
    found = {v.name: v.figures(v.run()) for v in variants}
    names = ["exact", "own pixels", "near views first", "both, the default", "half size, scaled up", "SH degree 0",
             "SH degree 1"]  # fmt: skip
    assert [v.name for v in variants][:7] == names
    assert [v.baseline.name if v.baseline else None for v in variants][:7] == [None] * 3 + ["exact"] + [None] * 3
    assert found["exact"]["psnr_exact"] == 150 and found["exact"]["max_error"] < 1e-3
    assert found["SH degree 0"]["psnr_exact"] < found["SH degree 1"]["psnr_exact"] < 149
    assert 15 < found["half size, scaled up"]["psnr_exact"] < 149
