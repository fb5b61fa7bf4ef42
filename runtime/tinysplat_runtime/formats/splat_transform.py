"""Formats that PlayCanvas' command-line program `splat-transform` converts: SOG out, and SOG, splat and ksplat in.

The program (MIT, npm package @playcanvas/splat-transform) does the work; a .ply file stands in between. It runs on the
CPU, because whether a GPU is usable shows only after a while.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from .ply import read_ply, write_ply

PROGRAM = "splat-transform"
READS = (".sog", ".splat", ".ksplat")
WRITES = (".sog",)


def write_sog(path: Path, gaussians: Gaussians, means: NDArray) -> None:
    """Write points (N,) with world positions `means` (N, 3) float32 as SOG.

    Raises:
        InputError: the program is missing or fails.
        ImportError: plyfile is not installed.
    """
    with tempfile.TemporaryDirectory() as folder:
        between = Path(folder) / "in.ply"
        write_ply(between, gaussians, means)
        written = Path(folder) / "out.sog"
        _run("-g", "cpu", str(between), str(written))
        shutil.copyfile(written, path)


def read_foreign(path: Path, max_bytes: int) -> dict[str, NDArray]:
    """Read a file of one of READS; see `ply.read_ply` for arrays and errors."""
    with tempfile.TemporaryDirectory() as folder:
        between = Path(folder) / "out.ply"
        _run(str(path), str(between))
        return read_ply(between, max_bytes)


def _run(*arguments: str) -> None:
    program = shutil.which(PROGRAM)
    if program is None:
        formats = ", ".join(READS)
        raise InputError(f"{formats} need the program {PROGRAM}; npm install -g @playcanvas/splat-transform")
    done = subprocess.run([program, "-q", *arguments], capture_output=True, text=True, check=False)
    if done.returncode or not Path(arguments[-1]).is_file():
        lines = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        raise InputError(f"{PROGRAM} failed ({lines[-1][:160] if lines else f'exit status {done.returncode}'})")
