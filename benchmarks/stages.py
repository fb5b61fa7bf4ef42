"""Where the time goes, on one thread: CSV lines of decoding, the synthesis graph, encoding and frames, and a plot.

    python benchmarks/stages.py PLOT.png [--rounds 9]

Time is a call's own: what a timed call within it takes counts there alone, and what no timed call takes is `rest`. The
graph's operators are onnxruntime's own profile; the stages of encoding are those of `--report`. Medians of the rounds.
"""

from __future__ import annotations

import argparse
import csv
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import onnxruntime as ort
from render import SMALL, view_of
from render import made_gaussians as rolling_surface

from tinysplat.bench.inputs import made_gaussians as network_like
from tinysplat_runtime import Runtime
from tinysplat_runtime.codec import decoder
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.codec.hevc import PictureDecoder, PlaneDecoder
from tinysplat_runtime.codec.synthesis import LayerSynthesis
from tinysplat_runtime.container.records import Container
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.graphs.inference import Graph
from tinysplat_runtime.render import Renderer, composite, project, renderer, tiles

Place = tuple[Any, str]
"""A module or class, and the name in it of what is timed."""

Seconds = dict[str, float]

REST = "rest"

DECODE: Mapping[str, Sequence[Place]] = {
    "metadata": [(decoder, "read_container"), (LayerSynthesis, "__init__")],
    "CRC": [(Container, "payload")],
    "libavcodec": [(PictureDecoder, "decode")],
    "copy of pictures": [(PlaneDecoder, "decode_into")],
    "synthesis graph": [(Graph, "run_into")],
}

FRAME: Mapping[str, Sequence[Place]] = {
    "projection": [(renderer, "project")],
    "colours": [(project, "_colours")],
    "depth order": [(renderer, "depth_order")],
    "tiles of every splat": [(tiles, "_pairs")],
    "lists by tile": [(renderer, "find_pairs"), (renderer, "tile_groups")],
    "blend: picking records": [(composite, "_planes")],
    "blend: alphas": [(composite, "_alphas")],
    "blend: sums": [(composite, "_blend")],
    "blend: rest": [(renderer, "composite")],
}


def compiled_frame() -> Mapping[str, Sequence[Place]]:
    """Parts of a compiled frame."""
    from tinysplat_runtime.render import kernels_blend, kernels_project

    return {
        "projection and colours": [(kernels_project, "project")],
        "listing what is visible": [(kernels_blend, "list_visible")],
        "lists by tile": [(kernels_blend, "list_by_tile")],
        "sort and blend": [(kernels_blend, "composite_tile")],
    }


class OwnTime:
    """Seconds of calls by their label, less those of timed calls within them; for calls of one thread."""

    def __init__(self) -> None:
        self.seconds: Seconds = {}
        self._within = [0.0]

    def timed(self, label: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, timed."""

        def run(*args: Any, **options: Any) -> Any:
            self._within.append(0.0)
            start = time.perf_counter()
            try:
                return call(*args, **options)
            finally:
                spent = time.perf_counter() - start
                self.seconds[label] = self.seconds.get(label, 0.0) + spent - self._within.pop()
                self._within[-1] += spent

        return run


@contextmanager
def own_time(parts: Mapping[str, Sequence[Place]]) -> Iterator[OwnTime]:
    """While open, what `parts` names is timed."""
    clock = OwnTime()
    with ExitStack() as stack:
        for label, places in parts.items():
            for owner, name in places:
                stack.enter_context(patch.object(owner, name, _timed(clock, label, getattr(owner, name))))
        yield clock


def _timed(clock: OwnTime, label: str, call: Callable[..., Any]) -> Callable[..., Any]:
    timed = clock.timed(label, call)
    return lambda *args, **options: timed(*args, **options)  # a function, which a class binds


def once(run: Callable[[], Any], parts: Mapping[str, Sequence[Place]]) -> Seconds:
    """Seconds of the parts of one call, `REST` among them."""
    with own_time({REST: [], **parts}) as clock:
        clock.timed(REST, run)()
    return clock.seconds


def encoding(runtime: Runtime) -> Callable[[], Seconds]:
    """Encoding by `balanced`: seconds of its stages."""
    gaussians = network_like(2, 256, 256, 3)

    def run() -> Seconds:
        stats, start = EncodeStats(), time.perf_counter()
        runtime.compress(gaussians, "balanced", drop_invalid=True, stats=stats)
        spent = time.perf_counter() - start
        return {**stats.watch.seconds, REST: spent - sum(stats.watch.seconds.values())}

    return run


def graph_operators(runtime: Runtime, data: bytes, rounds: int) -> list[Seconds]:
    """Seconds of the synthesis graph's operators, by kind, in as many decodings of a file."""
    graph = runtime.store.transform("synthesis")
    options = ort.SessionOptions()
    options.intra_op_num_threads, options.enable_profiling = 1, True
    with tempfile.TemporaryDirectory() as folder:
        options.profile_file_prefix = str(Path(folder) / "profile")
        session = ort.InferenceSession(find_artifact("synthesis", "synthesis").read(), options)
        profiled = replace(graph, session=session)
        with patch.object(Graph, "run_into", partial(_run_instead, profiled, Graph.run_into)):
            for _ in range(rounds + 1):
                runtime.decompress(data)
        events = json.loads(Path(session.end_profiling()).read_text())
    nodes = [event for event in events if event["name"].endswith("_kernel_time")]
    return [_by_kind(run) for run in _split(nodes, rounds + 1)[1:]]  # the first one warms up


def _run_instead(graph: Graph, run_into: Callable[..., None], inputs: Any, outputs: Any) -> None:
    run_into(graph, inputs, outputs)


def _split(events: Sequence[Any], count: int) -> list[Sequence[Any]]:
    each = len(events) // count
    return [events[start : start + each] for start in range(0, len(events), each)]


KINDS = ("MatMul", "Split", "Concat", "Cast", "Transpose", "Where")


def _by_kind(nodes: Sequence[Any]) -> Seconds:
    """The product that makes SH coefficients is the largest output of all."""
    seconds: Seconds = {}
    largest = max(int(node["args"]["output_size"]) for node in nodes)
    for node in nodes:
        kind = node["args"]["op_name"]
        label = kind if kind in KINDS else "other operators"
        if kind == "MatMul":
            label = "SH product" if int(node["args"]["output_size"]) == largest else "other products"
        seconds[label] = seconds.get(label, 0.0) + 1e-6 * node["dur"]
    return seconds


def frame(compiled: bool) -> Callable[[], Seconds]:
    """A frame of 131,072 Gaussians seen from a camera that moves, so that colours are made anew."""
    gaussians = rolling_surface(*SMALL)
    drawn, camera, parts = Renderer(gaussians, 1, compiled=compiled), view_of(gaussians), FRAME
    if compiled:
        parts = compiled_frame()
    places = [camera, gaussians.cameras[0]]

    def run() -> Seconds:
        places.reverse()
        return once(lambda: drawn.render(places[0], SMALL[1:]), parts)

    return run


def measure(rounds: int) -> dict[str, Seconds]:
    """Median seconds of every part, by what is done."""
    runtime = Runtime(threads=1)
    data = runtime.compress(network_like(2, 256, 256, 3), "balanced", drop_invalid=True)
    works = {
        "decode 2×256×256": lambda: once(lambda: runtime.decompress(data), DECODE),
        "encode balanced 2×256×256": encoding(runtime),
        "frame in numpy 256×256": frame(compiled=False),
        "frame compiled 256×256": frame(compiled=True),
    }
    seen: dict[str, list[Seconds]] = {name: [] for name in works}
    for count in range(rounds + 2):
        for name, work in works.items():
            seconds = work()
            if count > 1:  # both of the frame's places are drawn once before
                seen[name].append(seconds)
    seen["synthesis graph, onnxruntime's profile"] = graph_operators(runtime, data, rounds)
    return {name: _medians(runs) for name, runs in seen.items()}


def _medians(runs: Sequence[Seconds]) -> Seconds:
    labels = dict.fromkeys(label for run in runs for label in run)
    medians = {label: statistics.median(run.get(label, 0.0) for run in runs) for label in labels}
    return dict(sorted(medians.items(), key=lambda part: (part[0] == REST, -part[1])))


def plot(path: Path, works: Mapping[str, Seconds]) -> None:
    """A bar per work, its parts beside each other; those of 4 % and more are named."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 0.9 * len(works) + 0.6), layout="constrained")
    axes = figure.subplots()
    for row, parts in enumerate(works.values()):
        left, total = 0.0, sum(parts.values())
        for number, (label, seconds) in enumerate(parts.items()):
            share = 100 * seconds / total
            colour = "lightgrey" if label == REST else colormaps["tab20"](number * 2 % 20 + number * 2 // 20)
            axes.barh(row, share, left=left, color=colour, edgecolor="white")
            if share >= 4:
                words = label if share >= 0.9 * len(label) else label.replace(" ", "\n")
                axes.text(left + share / 2, row, f"{words}\n{1e3 * seconds:.3g}", ha="center", va="center", fontsize=7)
            left += share
    names = [f"{name}\n{1e3 * sum(parts.values()):.4g} ms" for name, parts in works.items()]
    axes.set_yticks(range(len(works)), names)
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("% of the time on one thread; milliseconds in the bars")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("plot", type=Path)
    parser.add_argument("--rounds", type=int, default=9)
    args = parser.parse_args()
    works = measure(args.rounds)
    writer = csv.writer(sys.stdout)
    writer.writerow(("work", "part", "milliseconds", "share"))
    for name, parts in works.items():
        total = sum(parts.values())
        for label, seconds in parts.items():
            writer.writerow((name, label, f"{1e3 * seconds:.2f}", f"{seconds / total:.3f}"))
    plot(args.plot, works)


if __name__ == "__main__":
    main()
