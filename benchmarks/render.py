"""Time and memory of the rasteriser: one JSON line per case.

    python benchmarks/render.py [GAUSSIANS.npz] [--rounds 15] [--threads 1 2] [--compiled]

Cases: 131,072 per-pixel Gaussians of SH degree 3 at 256×256 and 512×512, and 1,048,576 at 960×540, made up here; or
the given Gaussians at 256×256, 512×512 and 960×540. Cases and thread counts take turns, round by round, so that what
else the machine does falls on all of them alike.

A line holds the median, fastest and slowest wall-clock seconds of a frame from a prepared `Renderer`, its median CPU
seconds, the seconds of preparing, and the peak of resident memory that preparing and rendering add to the Gaussians
themselves, measured in a process of its own (Linux; null elsewhere).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tinysplat_runtime import Camera, Gaussians, __version__, load_gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats
from tinysplat_runtime.render import Renderer

SMALL, LARGE = (2, 256, 256), (4, 512, 512)
PICTURES = {"small": ((256, 256), (512, 512)), "large": ((540, 960),)}
SPLAT_PX = 0.4
"""Median standard deviation of a Gaussian in pixels of its own view; near what networks such as MVSplat put out."""


@dataclass(frozen=True)
class Case:
    """One picture: whose Gaussians ("small", "large" or "given"), its (height, width), threads, and which code."""

    scene: str
    size: tuple[int, int]
    threads: int
    compiled: bool = False


def made_gaussians(views: int, height: int, width: int, degree: int = 3) -> Gaussians:
    """Per-pixel Gaussians of a rolling surface, 2 to 4 units deep, from cameras side by side."""
    rng = np.random.default_rng(0)
    K = np.array([[0.9 * width, 0, width / 2], [0, 0.9 * width, height / 2], [0, 0, 1]])
    y, x = np.mgrid[0:height, 0:width] + 0.5
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], axis=-1)
    cameras, means = [], []
    for view in range(views):
        c2w = np.eye(4)
        c2w[0, 3] = 0.2 * (view - (views - 1) / 2)
        cameras.append(Camera(K, c2w, width, height))
        waves = np.sin(9 * x / width + view) * np.cos(7 * y / height) + 0.02 * rng.normal(size=x.shape)
        means.append(rays * (3 + waves)[..., None] + c2w[:3, 3])
    lead = (views, height, width)
    points = np.stack(means)
    scales = SPLAT_PX / K[0, 0] * points[..., 2:] * np.exp(0.4 * rng.normal(size=(*lead, 3)))
    sh = 0.15 * rng.normal(size=(*lead, (degree + 1) ** 2, 3))
    sh[..., 0, :] *= 8
    return Gaussians(
        points, normalize_quats(rng.normal(size=(*lead, 4))), scales, rng.uniform(0.3, 0.95, lead), sh, tuple(cameras)
    )


def load(scene: str, path: Path | None) -> Gaussians:
    """The Gaussians of a scene's name."""
    if path is not None:
        return load_gaussians(path)
    return made_gaussians(*(SMALL if scene == "small" else LARGE))


def view_of(gaussians: Gaussians) -> Camera:
    """Halfway between the first two cameras, where no Gaussian falls on a pixel's centre."""
    first, second = gaussians.cameras[0], gaussians.cameras[min(1, len(gaussians.cameras) - 1)]
    c2w = first.c2w.copy()
    c2w[:3, 3] = (first.centre + second.centre) / 2
    return Camera(first.K, c2w, first.width, first.height)


def peak_bytes(case: Case, path: Path | None) -> int | None:
    """Peak of resident memory above the loaded Gaussians while one frame is prepared and rendered, in a new process."""
    command = [sys.executable, __file__, *([str(path)] if path else []), "--measure-memory", json.dumps(vars(case))]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def measure_memory(case: Case, path: Path | None) -> int | None:
    """What `peak_bytes` runs."""
    gaussians = load(case.scene, path)
    camera = view_of(gaussians)
    status, marks = Path("/proc/self/status"), Path("/proc/self/clear_refs")
    if not marks.exists():
        return None
    marks.write_text("5")  # sets the high-water mark back to what is resident now
    before = _status_bytes(status, "VmRSS")
    Renderer(gaussians, case.threads, compiled=case.compiled).render(camera, case.size)
    return _status_bytes(status, "VmHWM") - before


def _status_bytes(status: Path, name: str) -> int:
    line = next(line for line in status.read_text().splitlines() if line.startswith(name))
    return 1024 * int(line.split()[1])


def time_cases(cases: Sequence[Case], path: Path | None, rounds: int) -> dict[Case, dict[str, float | int]]:
    """Seconds per frame and of preparation, by case, in interleaved rounds."""
    scenes = {case.scene: load(case.scene, path) for case in cases}
    renderers: dict[tuple[str, int, bool], tuple[Renderer, float]] = {}
    for case in cases:
        if _key(case) not in renderers:
            start = time.perf_counter()
            renderer = Renderer(scenes[case.scene], case.threads, compiled=case.compiled)
            renderers[_key(case)] = renderer, time.perf_counter() - start
    wall: dict[Case, list[float]] = {case: [] for case in cases}
    cpu: dict[Case, list[float]] = {case: [] for case in cases}
    for count in range(rounds + 1):
        for case in cases:
            renderer, _ = renderers[_key(case)]
            camera = view_of(scenes[case.scene])
            start, start_cpu = time.perf_counter(), time.process_time()
            renderer.render(camera, case.size)
            if count:  # the first round warms up
                wall[case].append(time.perf_counter() - start)
                cpu[case].append(time.process_time() - start_cpu)
    return {
        case: {
            "gaussians": scenes[case.scene].count,
            "sh_degree": scenes[case.scene].degree,
            "seconds": statistics.median(wall[case]),
            "seconds_min": min(wall[case]),
            "seconds_max": max(wall[case]),
            "cpu_seconds": statistics.median(cpu[case]),
            "prepare_seconds": renderers[_key(case)][1],
        }
        for case in cases
    }


def _key(case: Case) -> tuple[str, int, bool]:
    return case.scene, case.threads, case.compiled


def environment() -> dict[str, str | int | None]:
    """What a figure depends on besides the code's own speed."""
    commit = subprocess.run(
        ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"], capture_output=True, text=True
    )
    return {
        "tinysplat": __version__,
        "commit": commit.stdout.strip() or None,
        "numpy": np.__version__,
        "python": platform.python_version(),
        "cpu": _cpu_name(),
        "cores": os.cpu_count(),
    }


def _cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def main(argv: Sequence[str] | None = None) -> None:
    """Parse arguments, measure, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("gaussians", nargs="?", type=Path, help="a .npz of per-pixel Gaussians; default: made up")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--compiled", action="store_true", help="beside numpy, compiled by numba (tinysplat[fast])")
    parser.add_argument("--measure-memory", metavar="CASE", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.measure_memory:
        case = json.loads(args.measure_memory)
        print(json.dumps(measure_memory(Case(**{**case, "size": tuple(case["size"])}), args.gaussians)))
        return
    pictures = {"given": (*PICTURES["small"], *PICTURES["large"])} if args.gaussians else PICTURES
    cases = [
        Case(scene, size, n, compiled)
        for scene, sizes in pictures.items()
        for size in sizes
        for n in args.threads
        for compiled in ((False, True) if args.compiled else (False,))
    ]
    for case, figures in time_cases(cases, args.gaussians, args.rounds).items():
        name = f"render {case.scene} {case.size[1]}x{case.size[0]}"
        peak = peak_bytes(case, args.gaussians)
        line = {
            "case": name,
            "threads": case.threads,
            "compiled": case.compiled,
            **figures,
            "rounds": args.rounds,
            "peak_bytes": peak,
        }
        print(json.dumps({**line, **environment()}), flush=True)


if __name__ == "__main__":
    main()
