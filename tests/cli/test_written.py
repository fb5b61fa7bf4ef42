"""What `decode` and `convert` write, and what `compress` and `encode` say of what they wrote."""

from __future__ import annotations

from pathlib import Path

import console
import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli.files import Reading, noted
from tinysplat_runtime.container.records import Limits
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.editing import cut_degree, drop_transparent, trim_border
from tinysplat_runtime.gaussian.footprints import widened
from tinysplat_runtime.recipe.export import ExportRequest, exported
from tinysplat_runtime.system.stopwatch import Stopwatch

READING = Reading(1, None, Limits(), None, False, None)


def same(a: ts.Gaussians, b: ts.Gaussians) -> bool:
    fields = ("means", "quats", "scales", "opacities", "sh")
    return all(np.array_equal(getattr(a.flat(), name), getattr(b.flat(), name)) for name in fields)


def test_a_selection_is_what_its_options_say_in_their_order() -> None:
    g, runtime = make_smooth_gaussians(2, 12, 16, degree=2), ts.Runtime(threads=1)

    def out(**options: object) -> ts.Gaussians:
        return exported([("", g)], "g.ply", ExportRequest.of(**options), runtime)

    assert out() is g and out(trim_border=0) is g  # of few views none is left out
    assert same(out(dilate=0.3), widened(g, 0.3))
    assert same(out(trim_border=2, sh_degree=1), cut_degree(trim_border(g, 2), 1))
    assert same(out(min_opacity=0.5), drop_transparent(g, 0.5))
    assert out(sh_degree=0).degree == 0


def test_notes_are_put_over_those_there_are_and_errors_name_their_option() -> None:
    g = make_smooth_gaussians(1, 4, 4).with_notes(ts.Notes(unit="metre", licence="CC0-1.0"))
    assert noted(g, {}) is g
    found = noted(g, {"unit": "inch", "attribution": "us"}).notes
    assert (found.unit, found.licence, found.attribution) == ("inch", "CC0-1.0", "us")
    with pytest.raises(InputError, match=r"^--unit: "):
        noted(g, {"unit": "x" * 9000})


@pytest.mark.parametrize(
    ("words", "option"),
    [("--mode photos", "--mode"), ("--refine 2", "--photos"), ("--photos desk", "--refine"), ("--grid 1,2", "--grid")],
)
def test_compress_says_what_goes_with_what(tmp_path: Path, words: str, option: str) -> None:
    assert option in console.fail("compress", "g.npz", "-o", tmp_path / "f.tsplat", *words.split())


def test_what_is_read_in_part_is_a_tsplat_file(tmp_path: Path) -> None:
    ts.save_gaussians(tmp_path / "g.npz", make_smooth_gaussians(2, 4, 4))
    file = str(tmp_path / "g.npz")
    for fields, option in (({"max_bytes": 9}, "--max-bytes"), ({"partial": True}, "--partial")):
        reading = Reading(**{**vars(READING), **fields})
        assert reading.is_in_part and not READING.is_in_part
        with pytest.raises(InputError, match=option):
            reading.load(file, Stopwatch())
    one = Reading(**{**vars(READING), "views": [1]}).load(file, Stopwatch())
    assert one.count == 16 and READING.load(file, Stopwatch()).count == 32
    with pytest.raises(InputError, match=r"g\.npz: "):
        Reading(**{**vars(READING), "views": [2]}).load(file, Stopwatch())
