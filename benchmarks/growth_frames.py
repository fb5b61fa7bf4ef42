"""Growth of a frame and of decoding well beyond the ordinary: CSV lines, and a log–log plot with slopes.

    python benchmarks/growth_frames.py PLOT.png [--rounds 5] [--threads 2]

Frames by the picture's pixels, the number of Gaussians, and their size (which is how many tiles and other Gaussians
each overlaps), in numpy and compiled; decoding by pixels and by views. A slope of 1 is growth in proportion; a line is
called linear from where the slope to each further point lies within 0.85 and 1.15.
"""

from __future__ import annotations

import argparse
import csv
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from render import made_gaussians, view_of

from tinysplat.bench.inputs import made_gaussians as network_like
from tinysplat_runtime import Gaussians, Runtime
from tinysplat_runtime.render import Renderer

WITHIN = 0.15

Point = tuple[float, Callable[[], Any]]


def frames(compiled: bool, threads: int) -> Iterator[tuple[str, list[Point]]]:
    """Axes of a frame."""
    scene = made_gaussians(2, 256, 256)

    def frame(gaussians: Gaussians, height: int, width: int) -> Callable[[], Any]:
        renderer = Renderer(gaussians, threads, compiled=compiled)
        camera = view_of(gaussians)
        return lambda: renderer.render(camera, (height, width))

    sizes = ((64, 64), (128, 128), (256, 256), (512, 512), (1080, 1920), (2160, 3840))
    yield "pixels of the picture", [(h * w, frame(scene, h, w)) for h, w in sizes]
    scenes = [made_gaussians(2, side, side) for side in (32, 64, 128, 256, 512)]
    yield "Gaussians", [(g.count, frame(g, 256, 256)) for g in scenes]
    yield (
        "size of Gaussians",
        [(factor, frame(replace(scene, scales=scene.scales * factor), 256, 256)) for factor in (1, 2, 4, 8, 16)],
    )


def decoding(threads: int) -> Iterator[tuple[str, list[Point]]]:
    """Axes of decoding."""
    runtime = Runtime(threads=threads)

    def decode(views: int, height: int, width: int) -> Callable[[], Any]:
        data = runtime.compress(network_like(views, height, width, 3), "fast", drop_invalid=True)
        return lambda: runtime.decompress(data)

    sizes = ((64, 64), (128, 128), (256, 256), (512, 512), (512, 960))
    yield "pixels of a view", [(h * w, decode(2, h, w)) for h, w in sizes]
    yield "views", [(views, decode(views, 128, 128)) for views in (1, 2, 4, 8, 16)]


def seconds(run: Callable[[], Any], rounds: int) -> float:
    """Median, after a call to warm up."""
    run()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def slopes(points: Sequence[tuple[float, float]]) -> list[float]:
    """Between neighbours, in a log–log plot."""
    return [math.log(b[1] / a[1]) / math.log(b[0] / a[0]) for a, b in pairwise(points)]


def linear_from(points: Sequence[tuple[float, float]]) -> float | None:
    """The x from which growth is in proportion to the end, or None."""
    first = None
    for (x, _), slope in zip(points, slopes(points), strict=False):
        first = (x if first is None else first) if abs(slope - 1) <= WITHIN else None
    return first


def plot(path: Path, lines: dict[tuple[str, str], list[tuple[float, float]]]) -> None:
    """A panel per axis."""
    from matplotlib.figure import Figure

    axes_names = list(dict.fromkeys(axis for _, axis in lines))
    figure = Figure(figsize=(3.6 * len(axes_names), 3.4), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(axes_names)), axes_names, strict=True):
        for (what, axis), points in lines.items():
            if axis == name:
                label = f"{what}, last slope {slopes(points)[-1]:.2f}"
                axes.loglog(*zip(*points, strict=True), "o-", label=label)
        x, y = axes.get_xlim(), axes.get_ylim()
        axes.loglog(x, [y[0], y[0] * x[1] / x[0]], ":", color="grey", label="slope 1")
        axes.set(xlabel=name, ylabel="seconds", xlim=x, ylim=y)
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=90)


def main() -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("plot", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    writer = csv.writer(sys.stdout)
    writer.writerow(("what", "by", "x", "milliseconds", "slope from the point before", "linear from"))
    lines: dict[tuple[str, str], list[tuple[float, float]]] = {}
    work = [("frame, numpy", frames(False, args.threads)), ("frame, compiled", frames(True, args.threads))]
    for what, axes in (*work, ("decode", decoding(args.threads))):
        for axis, points in axes:
            line = [(x, seconds(run, args.rounds)) for x, run in points]
            lines[what, axis] = line
            steps = ["", *(f"{slope:.2f}" for slope in slopes(line))]
            for (x, cost), step in zip(line, steps, strict=True):
                writer.writerow((what, axis, x, f"{1e3 * cost:.2f}", step, linear_from(line) or ""))
            sys.stdout.flush()
    plot(args.plot, lines)


if __name__ == "__main__":
    main()
