"""The process in which usd-core reads a file: `python -m tinysplat_runtime.formats.usd_worker FILE OUT.npz MAX_BYTES`.

Writes the arrays of `usd.read_usd` about axes with y up, how many prims are `hidden`, and `notes`, JSON.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.notes import NAMES
from .assembly import joined
from .axes import placed

TYPE = "ParticleField3DGaussianSplat"
NOTE_KEY = "tinysplat:"
"""Of a prim's `customData`; the note's name follows."""

SECONDS, MEMORY_FACTOR, MEMORY_BASE = 240, 40, 3 << 28
"""Bounds of processor time and of address space beyond the library's own, of which reading anything takes 0.4 GB."""


def stage_arrays(path: str, max_bytes: int) -> dict[str, NDArray]:
    """Arrays of all Gaussians of a stage in its world's axes, y up: (N, …) float, by name; `hidden` is how many prims
    are invisible, or guides or stand-ins for others, and left out.

    Raises:
        ValueError: references to other files, no Gaussians that show, or arrays that do not fit each other.
    """
    from pxr import UsdGeom

    stage = _stage(path)
    z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    parts, hidden = [], 0
    cache = UsdGeom.XformCache()
    for prim in stage.Traverse():
        if prim.GetTypeName() != TYPE:
            continue
        if not _is_shown(UsdGeom.Imageable(prim)):
            hidden += 1
        else:
            parts.append(_placed(_prim_arrays(prim, max_bytes), np.array(cache.GetLocalToWorldTransform(prim)).T, z_up))
    if not parts:
        raise ValueError(f"no prim of type {TYPE}" + (f" but {hidden} that are hidden" if hidden else ""))
    return {**joined(parts), "hidden": np.array(hidden)}


def stage_notes(path: str) -> dict[str, str]:
    """What the prims of a stage say of themselves, the first to say it."""
    stage, notes = _stage(path), dict[str, str]()
    for prim in stage.Traverse():
        for name in NAMES:
            text = prim.GetCustomDataByKey(NOTE_KEY + name)
            if isinstance(text, str):
                notes.setdefault(name, text)
    return notes


def _stage(path: str) -> Any:
    from pxr import Sdf, Usd

    layer = Sdf.Layer.FindOrOpen(path)
    if layer is None:
        raise ValueError("does not open")
    outside = [str(name) for name in layer.GetCompositionAssetDependencies()]
    if outside:
        raise ValueError(f"refers to another file ({outside[0][:60]}), expected one that stands alone")
    return Usd.Stage.Open(layer, Usd.Stage.LoadNone)


def _is_shown(prim: Any) -> bool:
    from pxr import UsdGeom

    tokens = UsdGeom.Tokens
    return prim.ComputeVisibility() != tokens.invisible and prim.ComputePurpose() in (tokens.default_, tokens.render)


def _prim_arrays(prim: Any, max_bytes: int) -> dict[str, NDArray]:
    def values(name: str, width: int) -> NDArray:
        for suffix in ("", "h"):  # float before half
            attribute = prim.GetAttribute(name + suffix)
            value = attribute.Get() if attribute and attribute.HasAuthoredValue() else None
            if value is not None and len(value):
                if len(value) * width * 8 > max_bytes:
                    raise ValueError(f"{name}: {len(value)} values, more than {max_bytes} bytes can hold")
                return np.array(value, np.float64).reshape(len(value), -1)
        raise ValueError(f"lacks {name}")

    degree = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get()
    if not isinstance(degree, int) or not 0 <= degree <= 4:
        raise ValueError(f"SH degree {degree}, expected 0 to 4")
    functions = (degree + 1) ** 2
    means = values("positions", 3)
    arrays = {
        "means": means,
        "quats": np.roll(values("orientations", 4), 1, axis=1),  # in memory xyzw
        "scales": values("scales", 3),
        "opacities": values("opacities", 1)[:, 0],
        "sh": values("radiance:sphericalHarmonicsCoefficients", 3)[: len(means) * functions],
    }
    if len(arrays["sh"]) != len(means) * functions:
        raise ValueError(f"{len(arrays['sh'])} SH coefficients for {len(means)} Gaussians of degree {degree}")
    arrays["sh"] = arrays["sh"].reshape(len(means), functions, 3)
    for name, array in arrays.items():
        if len(array) != len(means):
            raise ValueError(f"{name}: {len(array)} values for {len(means)} positions")
    return arrays


def _placed(arrays: dict[str, NDArray], matrix: NDArray, z_up: bool) -> dict[str, NDArray]:
    if z_up:  # to y up: z becomes y, y becomes −z
        matrix = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]) @ matrix
    return placed(arrays, matrix)


def bound_process(memory: int, seconds: int) -> None:
    """Let this process take at most `memory` bytes of address space beyond what it holds, and so many CPU seconds."""
    try:
        import resource
    except ImportError:
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc/self/statm").exists() else 1 << 20
    held = pages * resource.getpagesize()
    for kind, wanted in ((resource.RLIMIT_AS, held + memory), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


def main(path: str, out: str, max_bytes: int) -> int:
    """Read and write; returns the exit status."""
    from pxr import Sdf, Usd, UsdGeom  # noqa: F401  # before the bound, which is of what comes after

    bound_process(MEMORY_BASE + MEMORY_FACTOR * Path(path).stat().st_size, SECONDS)
    try:
        arrays: dict[str, Any] = stage_arrays(path, max_bytes)
        arrays["notes"] = np.frombuffer(json.dumps(stage_notes(path)).encode(), np.uint8)
    except (ValueError, RuntimeError, MemoryError, InputError) as error:
        print(" ".join(str(error).split())[:200] or type(error).__name__, file=sys.stderr)
        return 1
    np.savez(out, **arrays)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
