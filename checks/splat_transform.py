"""Our .ply, .spz and .sog opened by PlayCanvas' splat-transform, value by value.

    npm install -g @playcanvas/splat-transform
    python checks/splat_transform.py

The program converts each file to a .ply, which is compared with what went in.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats

CASES = (  # suffix, version of SPZ; then means in units, angles in degrees, opacities, log scales, SH
    (".ply", 3, (1e-6, 0.1, 1e-5, 1e-5, 1e-6)),
    (".spz", 2, (1e-4, 16.0, 2.1e-3, 0.032, 0.07)),  # w follows from x, y, z of 8 bits
    (".spz", 3, (1e-4, 0.5, 2.1e-3, 0.032, 0.07)),
    (".spz", 4, (1e-4, 0.5, 2.1e-3, 0.032, 0.07)),
    (".sog", 3, (2e-3, 2.0, 4e-3, 0.1, 0.5)),
)


def some(count: int) -> Gaussians:
    """Points in a room a few units wide, SH degree 3 with most of its energy in the low degrees."""
    rng = np.random.default_rng(0)
    sh = rng.normal(scale=0.4, size=(count, 16, 3)) / (1 + np.arange(16))[:, None]
    scales = np.exp(rng.normal(-4, 0.5, (count, 3)))
    return Gaussians(rng.normal(size=(count, 3)), rng.normal(size=(count, 4)), scales, rng.uniform(0.05, 1, count), sh)


def nearest(gaussians: Gaussians, means: NDArray) -> NDArray:
    """For each of `means`, which Gaussian stands there: writers may change the order."""
    from scipy.spatial import cKDTree

    return cKDTree(gaussians.means).query(means)[1]


def errors(expected: Gaussians, actual: Gaussians) -> tuple[float, ...]:
    """Largest differences, in the order of CASES; for SH the root mean square."""
    rows = nearest(expected, actual.means)
    dots = np.abs((normalize_quats(expected.quats[rows]) * normalize_quats(actual.quats)).sum(-1)).clip(0, 1)
    return (
        float(np.abs(expected.means[rows] - actual.means).max()),
        float(np.degrees(2 * np.arccos(dots)).max()),
        float(np.abs(expected.opacities[rows] - actual.opacities).max()),
        float(np.abs(np.log(expected.scales[rows] / actual.scales)).max()),
        float(np.sqrt(np.mean((expected.sh[rows] - actual.sh) ** 2))),
    )


def main() -> int:
    """Write, convert, compare; returns the exit status."""
    gaussians, faults = some(2000), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for suffix, version, tolerances in CASES:
            start = time.perf_counter()
            save_gaussians(folder / f"g{suffix}", gaussians, spz_version=version)
            seconds = time.perf_counter() - start
            command = ["splat-transform", "-q", "-w", str(folder / f"g{suffix}"), str(folder / "back.ply")]
            subprocess.run(command, check=True, capture_output=True)
            differences = errors(gaussians, load_gaussians(folder / "back.ply"))
            ok = all(e <= t for e, t in zip(differences, tolerances, strict=True))
            faults += not ok
            size = (folder / f"g{suffix}").stat().st_size
            label = f"{suffix} version {version}" if suffix == ".spz" else suffix
            print(f"{label} {size} bytes {seconds:.2f} s", "ok" if ok else "WRONG", [f"{e:.3g}" for e in differences])
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
