"""The process that reads USD: what a stage's arrays may be, and how it ends."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdVol, Vt
from scenes import refusing

from tinysplat_runtime.errors import InputError, InputWarning
from tinysplat_runtime.formats import usd
from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.formats.usd_worker import stage_arrays, stage_notes


def stage_of(path: Path, degrees: tuple[int, ...] = (0,), count: int = 2, **changes: Any) -> str:
    """A stage with y up of one prim for each degree, each with so many Gaussians."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    for n, degree in enumerate(degrees):
        prim = UsdVol.ParticleField3DGaussianSplat.Define(stage, f"/P{n}")
        prim.CreatePositionsAttr(Vt.Vec3fArray([(n + 1, i, 3) for i in range(count)]))
        prim.CreateOrientationsAttr(Vt.QuatfArray([Gf.Quatf(0.5, 0.1, 0.2, 0.3)] * changes.get("quats", count)))
        prim.CreateScalesAttr(Vt.Vec3fArray([(0.1, 0.2, 0.3)] * changes.get("scales", count)))
        prim.CreateOpacitiesAttr(Vt.FloatArray([0.25] * changes.get("opacities", count)))
        prim.CreateRadianceSphericalHarmonicsDegreeAttr(changes.get("degree", degree))
        terms = changes.get("sh", count * (degree + 1) ** 2)
        prim.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray([(i, n, 0) for i in range(terms)]))
        prim.GetPrim().SetCustomDataByKey("tinysplat:unit", f"unit {n}")
        if n:
            prim.GetPrim().SetCustomDataByKey("tinysplat:licence", "CC0-1.0")
            prim.GetPrim().SetCustomDataByKey("tinysplat:attribution", 7)
    stage.GetRootLayer().Save()
    return str(path)


def test_prims_are_one_list_with_the_sh_of_the_highest_degree(tmp_path: Path) -> None:
    file = stage_of(tmp_path / "a.usda", (1, 0))
    found = stage_arrays(file, 1 << 20)
    np.testing.assert_array_equal(found["means"], [[1, 0, 3], [1, 1, 3], [2, 0, 3], [2, 1, 3]])
    np.testing.assert_allclose(found["quats"], [[0.5, 0.1, 0.2, 0.3]] * 4, rtol=1e-6)
    np.testing.assert_allclose(found["scales"], [[0.1, 0.2, 0.3]] * 4, rtol=1e-6)
    np.testing.assert_array_equal(found["opacities"], [0.25] * 4)
    assert found["sh"].shape == (4, 4, 3)
    np.testing.assert_array_equal(found["sh"][:2, :, 0], np.arange(8).reshape(2, 4))
    np.testing.assert_array_equal(found["sh"][2:, :, 0], [[0, 0, 0, 0], [1, 0, 0, 0]])
    np.testing.assert_array_equal(found["sh"][:, 0, 1], [0, 0, 1, 1])
    assert stage_notes(file) == {"unit": "unit 0", "licence": "CC0-1.0"}


def test_prims_that_do_not_show_are_left_out_and_counted(tmp_path: Path) -> None:
    stage = Usd.Stage.Open(stage_of(tmp_path / "a.usda", (0, 0, 0)))
    UsdGeom.Imageable(stage.GetPrimAtPath("/P0")).MakeInvisible()
    UsdGeom.Imageable(stage.GetPrimAtPath("/P2")).CreatePurposeAttr("guide")
    stage.GetRootLayer().Save()
    found = stage_arrays(str(tmp_path / "a.usda"), 1 << 20)
    np.testing.assert_array_equal(found["means"], [[2, 0, 3], [2, 1, 3]])
    assert found["hidden"] == 2
    with pytest.warns(InputWarning, match="2 prims"):
        load_gaussians(tmp_path / "a.usda")
    UsdGeom.Imageable(stage.GetPrimAtPath("/P1")).MakeInvisible()
    stage.GetRootLayer().Save()
    with refusing(ValueError, "hidden"):
        stage_arrays(str(tmp_path / "a.usda"), 1 << 20)


def test_more_sh_than_gaussians_need_is_cut_and_less_is_refused(tmp_path: Path) -> None:
    assert stage_arrays(stage_of(tmp_path / "a.usda", (1,), sh=11), 1 << 20)["sh"].shape == (2, 4, 3)
    with refusing(ValueError, "7 SH 2 1"):
        stage_arrays(stage_of(tmp_path / "b.usda", (1,), sh=7), 1 << 20)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"degree": 5}, "SH 5 0 4"),
        ({"quats": 1}, "quats: 1 values for 2 positions"),
        ({"opacities": 0}, "opacities"),
        ({"count": 0}, "positions"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, changes: dict[str, int], words: str) -> None:
    with refusing(ValueError, words):
        stage_arrays(stage_of(tmp_path / "a.usda", **changes), 1 << 20)


def test_what_a_reader_does_not_survive_is_one_line(tmp_path: Path, processes: Callable) -> None:
    for status, said, words in ((1, "a\nlast\n", "last"), (-9, "", ""), (0, " \n", ""), (1, "y" * 20_000, "yyy")):
        done = subprocess.CompletedProcess([], status, "", said)
        processes(lambda *_, done=done, **__: done)
        with pytest.raises(InputError) as error:
            usd.read_usd(tmp_path / "a.usd", 100)
        message = str(error.value)
        assert words in message and "\n" not in message and len(message) < 500

    def waits(*_: object, **options: Any) -> None:
        raise subprocess.TimeoutExpired("usd", options["timeout"])

    processes(waits)
    with pytest.raises(InputError):
        usd.read_usd(tmp_path / "a.usd", 100)
