"""Draw in turns with another checkout, a process each, one thread, and write rows.

    python paired.py CHECKOUT ROUNDS rows.jsonl CASE…

A case is SCENE/WAY/OPTIONS, for instance surface/numpy/default: surface, network and six are made Gaussians, one:N and
path:N clouds of N for one frame and along a path; OPTIONS is default or definition. CASE memory:N is the resident
memory of three frames along a path, compiled. Seconds are the processor's, ratios medians over rounds.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[3]
WARM = 2


def frames(scene: str, way: str, options: str) -> Callable[[], Any]:
    """A call that draws the next frame."""
    from tinysplat.measure.subjects.made import cloud, cloud_camera, made_gaussians, rolling_surface, view_between
    from tinysplat_runtime.render import DEFINITION, Renderer
    from tinysplat_runtime.scene.cameras import Camera

    kind, _, count = scene.partition(":")
    drawing = {"compiled": way == "compiled", **(DEFINITION if options == "definition" else {})}
    if kind in ("one", "path"):
        gaussians, camera, step = cloud(int(count)), cloud_camera(1080, 1920), 0.01
    else:
        made = {"surface": (rolling_surface, 2, 256, 3), "network": (made_gaussians, 2, 256, 3)}
        maker, views, side, degree = made.get(kind, (made_gaussians, 6, 128, 0))
        gaussians, step = maker(views, side, side, degree), 0.002
        camera = view_between(gaussians)
    if kind == "one":
        return lambda: Renderer(gaussians, 1, keep=False, **drawing).render(camera)
    renderer, number = Renderer(gaussians, 1, **drawing), iter(range(10_000))

    def frame() -> Any:
        c2w = camera.c2w.copy()
        c2w[0, 3] += step * next(number)
        return renderer.render(Camera(camera.K, c2w, camera.width, camera.height))

    return frame


def resident() -> int:
    """Bytes of this process's resident memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def memory(count: str) -> float:
    """Peak bytes a Gaussian beside the scene."""
    frames("path:2000", "compiled", "default")()
    draw, done = frames(f"path:{count}", "compiled", "default"), threading.Event()
    before = peak = resident()

    def watch() -> None:
        nonlocal peak
        while not done.wait(0.002):
            peak = max(peak, resident())

    watcher = threading.Thread(target=watch)
    watcher.start()
    for _ in range(3):
        draw()
    done.set()
    watcher.join()
    return (peak - before) / int(count)


def work() -> None:
    """Answer lines `CASE FILE` with seconds, and the picture in the file."""
    made: dict[str, Callable[[], Any]] = {}
    for line in sys.stdin:
        case, path = line.split()
        if case not in made:
            made = {case: frames(*case.split("/"))}
        start = time.process_time()
        image = made[case]()
        spent = time.process_time() - start
        np.save(path, image)
        print(spent, flush=True)


def process(root: Path, *arguments: str) -> subprocess.Popen[str]:
    """This script with a checkout's code."""
    env = {**os.environ, "PYTHONPATH": f"{root / 'runtime'}:{root}", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, __file__, *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env)


def drawn(workers: list[Any], case: str, rounds: int) -> dict[str, Any]:
    """A row of a case."""
    seconds: list[list[float]] = [[], []]
    psnr = np.inf
    with tempfile.TemporaryDirectory() as folder:
        paths = [f"{folder}/{which}.npy" for which in (0, 1)]
        for turn in range(WARM + rounds):
            for which in (0, 1) if turn % 2 else (1, 0):
                print(case, paths[which], file=workers[which].stdin, flush=True)
                spent = float(workers[which].stdout.readline())
                seconds[which] += [spent] if turn >= WARM else []
            error = np.square(np.load(paths[0]).astype(float) - np.load(paths[1])).mean()
            psnr = min(psnr, -10 * np.log10(error) if error else np.inf)
    old, new = np.array(seconds)
    costs = {"cpu": np.median(new), "baseline_cpu": np.median(old), "cpu_ratio": np.median(new / old)}
    costs |= {"least_cpu": new.min(), "baseline_least_cpu": old.min()}
    return {
        "case": case,
        "psnr": str(round(psnr, 1)),
        **{k: round(float(v), 4) for k, v in costs.items()},
        "rounds": rounds,
    }


def main() -> None:
    """See the module."""
    if sys.argv[1] == "work":
        return work()
    if sys.argv[1] == "memory":
        return print(memory(sys.argv[2]))
    roots, rounds, rows, cases = [Path(sys.argv[1]), HERE], int(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:]
    workers = [process(root, "work") for root in roots]
    for case in cases:
        if case.startswith("memory:"):
            old, new = (float(process(root, *case.split(":")).communicate()[0]) for root in roots)
            row = {"case": case, "bytes_a_gaussian": round(new, 1), "baseline_bytes_a_gaussian": round(old, 1)}
        else:
            row = drawn(workers, case, rounds)
        print(row, flush=True)
        with rows.open("a") as file:
            file.write(json.dumps(row) + "\n")
    for worker in workers:
        worker.stdin.close()


if __name__ == "__main__":
    main()
