"""Points as OpenUSD's ParticleField3DGaussianSplat (`.usd`, `.usda`, `.usdc`, `.usdz`), through the package usd-core.

y is up (`axes`), the scene's origin a translation of the prim, notes the prim's `customData`. SH coefficients are
Gaussian by Gaussian in the order of `gaussian.sh`. Schema: openusd.org, usdVol, OpenUSD 26.

The package's parser ends its process on some damaged files, so files are read in a process of their own (`usd_worker`),
which opens nothing but the file itself.
"""

import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, warn
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats
from ..system.files import parsing
from .assembly import Contents, WriteOptions
from .axes import HALF_TURN, QUAT_SIGNS, half_turned, sh_signs
from .usd_worker import NOTE_KEY

PRIM = "/Scene/Gaussians"

_SECONDS = 300


def write_usd(path: Path, gaussians: Gaussians, _: WriteOptions) -> list[str]:
    """Write points.

    Args:
        path: its suffix chooses between text, binary and package.
        gaussians: of any shape.

    Returns:
        What the format says otherwise, one line each.

    Raises:
        ImportError: usd-core is not installed.
    """
    from pxr import UsdUtils

    gaussians = gaussians.flat()
    if path.suffix.lower() != ".usdz":
        _stage(path, gaussians)
        return _losses(gaussians)
    with tempfile.TemporaryDirectory() as folder:
        inner = Path(folder) / "scene.usdc"
        _stage(inner, gaussians)
        packed = Path(folder) / "scene.usdz"
        if not UsdUtils.CreateNewUsdzPackage(str(inner), str(packed)):
            raise InputError("usd-core could not make a package")
        path.write_bytes(packed.read_bytes())
    return _losses(gaussians)


def read_usd(path: Path, max_bytes: int) -> Contents:
    """Read the Gaussians of all ParticleField3DGaussianSplat prims of a stage that show as one list, and their notes.

    Returns:
        means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), linear; means float64.

    Raises:
        InputError: damaged, without Gaussians, with references to other files, or larger than `max_bytes`.
        ImportError: usd-core is not installed.
    """
    arrays = _read(path, max_bytes)
    notes = json.loads(arrays.pop("notes").tobytes())
    if hidden := int(arrays.pop("hidden")):
        warn(f"{path}: {hidden} prims with Gaussians are invisible, guides or proxies, and left out")
    return half_turned(arrays), notes


def _read(path: Path, max_bytes: int) -> dict[str, NDArray]:
    """What the worker writes."""
    import pxr  # noqa: F401  # ImportError here rather than in the worker

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "arrays.npz"
        command = [sys.executable, "-m", f"{__package__}.usd_worker", str(path.resolve()), str(out), str(max_bytes)]
        modules = os.pathsep.join(entry for entry in sys.path if entry)  # the worker finds what this process found
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_SECONDS,
                check=False,
                env={**os.environ, "PYTHONPATH": modules, "PXR_WORK_THREAD_LIMIT": "1"},  # threads take address space
            )
        except subprocess.TimeoutExpired:
            raise InputError(f"not read within {_SECONDS} seconds") from None
        if done.returncode or not out.is_file():
            lines = done.stderr.strip().splitlines()
            raise InputError(f"damaged or foreign USD file ({lines[-1][:160] if lines else 'its reader ended'})")
        with parsing("USD file"), np.load(io.BytesIO(out.read_bytes())) as arrays:
            return dict(arrays)


def _stage(path: Path, gaussians: Gaussians) -> None:
    from pxr import Gf, Tf, Usd, UsdGeom, UsdVol, Vt

    path.unlink(missing_ok=True)  # the temporary file that stands here is empty, which is no layer
    try:
        stage = Usd.Stage.CreateNew(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"usd-core could not begin a file ({str(error).splitlines()[0][:120]})") from None
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/Scene")
    stage.SetDefaultPrim(root.GetPrim())
    prim = UsdVol.ParticleField3DGaussianSplat.Define(stage, PRIM)
    quats = normalize_quats(gaussians.quats.astype(np.float64)) * QUAT_SIGNS
    means = (gaussians.means * HALF_TURN).astype(np.float32)
    sh = (gaussians.sh * sh_signs(gaussians.degree)[:, None]).astype(np.float32)
    prim.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(means))
    xyzw = np.ascontiguousarray(np.roll(quats, -1, axis=1), np.float32)  # as Gf keeps them in memory
    prim.CreateOrientationsAttr(Vt.QuatfArray.FromNumpy(xyzw))
    prim.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(gaussians.scales))
    prim.CreateOpacitiesAttr(Vt.FloatArray.FromNumpy(gaussians.opacities))
    prim.CreateRadianceSphericalHarmonicsDegreeAttr(gaussians.degree)
    prim.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray.FromNumpy(sh.reshape(-1, 3)))
    prim.CreateSortingModeHintAttr(UsdVol.Tokens.zDepth)
    prim.CreateProjectionModeHintAttr(UsdVol.Tokens.perspective)
    reach = 3 * gaussians.scales.max(axis=1, keepdims=True)
    extent = np.stack([(means - reach).min(axis=0), (means + reach).max(axis=0)]).astype(np.float32)
    prim.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(extent))
    if gaussians.origin.any():
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(*(gaussians.origin * HALF_TURN).tolist()))
    for name, text in gaussians.notes.given().items():
        prim.GetPrim().SetCustomDataByKey(NOTE_KEY + name, text)
    stage.GetRootLayer().comment = "tinysplat"
    stage.GetRootLayer().Save()


def _losses(gaussians: Gaussians) -> list[str]:
    unit: object = gaussians.notes.unit
    return [] if unit in ("", "metre", "meter", "m") else [f"lengths are in {unit}, written as if they were metres"]
