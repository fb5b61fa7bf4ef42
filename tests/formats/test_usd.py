"""OpenUSD: what its own library finds in our files, and what we find in a stage made with it."""

from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdValidation, UsdVol, Vt
from scenes import make_gaussians, refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.notes import Notes
from tinysplat_runtime.gaussian.quaternions import normalize_quats

TURN = np.array([1.0, -1.0, -1.0])


def only_prim(stage: Usd.Stage) -> UsdVol.ParticleField3DGaussianSplat:
    (prim,) = (prim for prim in stage.Traverse() if prim.IsA(UsdVol.ParticleField3DGaussianSplat))
    return UsdVol.ParticleField3DGaussianSplat(prim)


def test_usd_finds_the_schemas_attributes_and_nothing_to_complain_of(tmp_path: Path) -> None:
    made = make_gaussians(degree=1)
    save_gaussians(tmp_path / "a.usda", made.with_notes(Notes("metre", "Jo Doe", "CC-BY-4.0")))
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y and stage.GetDefaultPrim()
    prim = only_prim(stage)
    np.testing.assert_array_equal(np.array(prim.GetPositionsAttr().Get()), made.flat().means * TURN.astype(np.float32))
    first = prim.GetOrientationsAttr().Get()[0]
    quat = normalize_quats(made.flat().quats[0]) * [1, 1, -1, -1]
    np.testing.assert_allclose([first.GetReal(), *first.GetImaginary()], quat, atol=1e-6)
    assert prim.GetRadianceSphericalHarmonicsDegreeAttr().Get() == 1
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0  # not USD's own hundredth
    assert prim.GetSortingModeHintAttr().Get() == UsdVol.Tokens.zDepth  # as we draw: by depth, not by distance
    assert prim.GetProjectionModeHintAttr().Get() == UsdVol.Tokens.perspective
    assert len(prim.GetRadianceSphericalHarmonicsCoefficientsAttr().Get()) == 4 * made.count
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in errors] == []


def test_a_stage_made_with_usd_is_read_where_its_nodes_put_it(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "hand.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    root = UsdGeom.Xform.Define(stage, "/Root")
    root.AddTranslateOp().Set(Gf.Vec3d(10, 0, 0))
    root.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    prim = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/Root/Splats")
    prim.CreatePositionsAttr(Vt.Vec3fArray([(1, 2, 3)]))
    prim.CreateOrientationsAttr(Vt.QuatfArray([Gf.Quatf(1, 0, 0, 0)]))
    prim.CreateScaleshAttr(Vt.Vec3hArray([Gf.Vec3h(0.5, 0.25, 1)]))  # halves, which stand in for floats
    prim.CreateOpacitiesAttr(Vt.FloatArray([0.5]))
    prim.CreateRadianceSphericalHarmonicsDegreeAttr(0)
    prim.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray([(0.1, 0.2, 0.3)]))
    stage.GetRootLayer().Save()
    read = load_gaussians(tmp_path / "hand.usda")
    # (12, 4, 6) with z up is (12, 6, −4) with y up, and (12, −6, 4) with y down
    np.testing.assert_allclose(read.means, [[12, -6, 4]])
    np.testing.assert_allclose(read.scales, [[1, 0.5, 2]])
    np.testing.assert_allclose(read.sh[:, 0], [[0.1, 0.2, 0.3]], atol=1e-6)


def test_files_that_refer_to_others_or_hold_nothing_are_refused(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "a.usda", make_gaussians())
    stage = Usd.Stage.CreateNew(str(tmp_path / "outside.usda"))
    stage.DefinePrim("/A").GetReferences().AddReference("./a.usda")
    stage.GetRootLayer().Save()
    with refusing(InputError, "outside.usda"):
        load_gaussians(tmp_path / "outside.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "empty.usda"))
    stage.GetRootLayer().Save()
    with refusing(InputError, "empty.usda"):
        load_gaussians(tmp_path / "empty.usda")
    (tmp_path / "bad.usdc").write_bytes(b"PXR-USDC" + bytes(200))
    with refusing(InputError, "bad.usdc"):
        load_gaussians(tmp_path / "bad.usdc")


def test_a_usd_prim_reaches_some_deviations_beyond_its_means(tmp_path: Path) -> None:
    means, scales = np.array([[1.0, 2, 3], [-4, 5, 6]]), np.array([[0.1, 0.5, 0.2], [1, 0.25, 0.125]])
    quats = np.tile([1.0, 0, 0, 0], (2, 1))
    g = Gaussians(means, quats, scales, np.array([0.5, 1]), np.zeros((2, 1, 3)), origin=np.array([1e6, 2e6, 0]))
    save_gaussians(tmp_path / "a.usda", g)
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    prim = only_prim(stage)
    low, high = np.array(prim.GetExtentAttr().Get())
    one, many = (share * scales.max(axis=1, keepdims=True) for share in (1, 9))
    for end, at in ((-low, -means * TURN), (high, means * TURN)):
        assert (end >= (at + one).max(axis=0)).all() and (end <= (at + many).max(axis=0)).all()
    np.testing.assert_allclose(prim.GetScalesAttr().Get(), scales, rtol=1e-6)
    place = UsdGeom.Xformable(prim).GetLocalTransformation()
    np.testing.assert_allclose(np.array(place)[3, :3], [1e6, -2e6, 0])
