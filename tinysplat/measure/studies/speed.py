"""Where does the time go?

Parts of decoding, encoding, frames and the synthesis graph, on one thread, are those that the runtime names
(`system.stopwatch.part`): a part's time is its own, less that of parts within it; what no part takes is `rest`. The
graph's operators are onnxruntime's own profile; the stages of encoding are those of `--report`. Medians of the rounds.
"""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import onnxruntime as ort

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.decoder import decode_gaussians
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.graphs.inference import Graph, GraphStore
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.system.stopwatch import watched_parts

from ..rows import Row, grouped
from ..show.plots import save_shares
from ..show.tables import Listing, duration, mean, percent, said
from ..study import Run, Study
from ..subjects.made import made_gaussians, rolling_surface, view_between

REST = "rest"
KINDS = ("MatMul", "Split", "Concat", "Cast", "Transpose", "Where")
"""The synthesis graph's operators that have a line of their own."""

Seconds = dict[str, float]


def part_rows(run: Run) -> Iterator[Row]:
    """Median seconds of every part, a row each, by what is done."""
    rounds = run.options.rounds or (3 if run.quick else 9)
    runtime, side = Runtime(threads=1), run.side
    gaussians = made_gaussians(2, side, side, 3)
    data = runtime.compress(gaussians, "balanced", drop_invalid=True)

    def encoding() -> Seconds:
        stats, start = EncodeStats(), time.perf_counter()
        runtime.compress(gaussians, "balanced", drop_invalid=True, stats=stats)
        spent = time.perf_counter() - start
        return {**stats.watch.seconds, REST: spent - sum(stats.watch.seconds.values())}

    works = {
        f"decode 2×{side}×{side}": lambda: _watched(lambda: runtime.decompress(data)),
        f"encode balanced 2×{side}×{side}": encoding,
        f"frame in numpy {side}×{side}": _frame(side, compiled=False),
    }
    if Renderer(gaussians).is_compiled:
        works[f"frame compiled {side}×{side}"] = _frame(side, compiled=True)
    seen: dict[str, list[Seconds]] = {name: [] for name in works}
    for count in range(rounds + 2):
        for name, work in works.items():
            found = work()
            if count > 1:  # both of the frame's places are drawn once before
                seen[name].append(found)
    seen["synthesis graph, onnxruntime's profile"] = graph_operators(data, rounds)
    for name, runs in seen.items():
        medians = {label: statistics.median(r.get(label, 0.0) for r in runs) for r in runs for label in r}
        total = sum(medians.values())
        for label, value in sorted(medians.items(), key=lambda item: (item[0] == REST, -item[1])):
            yield Row("parts", name, label, costs={"seconds": value, "share": value / total})


def _watched(work: Callable[[], Any]) -> Seconds:
    """Seconds of the parts of one call, `REST` among them."""
    with watched_parts() as parts:
        start = time.perf_counter()
        work()
        spent = time.perf_counter() - start
    return {**parts.seconds, REST: spent - sum(parts.seconds.values())}


def _frame(side: int, compiled: bool) -> Callable[[], Seconds]:
    """A frame of a camera that moves between two places, so that colours are made anew."""
    gaussians = rolling_surface(2, side, side)
    drawn, places = Renderer(gaussians, 1, compiled=compiled), [view_between(gaussians), gaussians.cameras[0]]

    def work() -> Seconds:
        places.reverse()
        return _watched(lambda: drawn.render(places[0]))

    return work


class _ProfilingStore(GraphStore):
    """Opens the synthesis graph with onnxruntime's profile."""

    def __init__(self, prefix: Path) -> None:
        super().__init__(threads=1)
        options = ort.SessionOptions()
        options.intra_op_num_threads, options.enable_profiling = 1, True
        options.profile_file_prefix = str(prefix)
        self.session = ort.InferenceSession(find_artifact("synthesis", "synthesis").read(), options)

    def transform(self, name: str) -> Graph:
        """See `GraphStore.transform`."""
        graph = super().transform(name)
        return replace(graph, session=self.session) if name == "synthesis" else graph


def graph_operators(data: bytes, rounds: int) -> list[Seconds]:
    """Seconds of the synthesis graph's operators, by kind, in as many decodings of a file."""
    with tempfile.TemporaryDirectory() as folder:
        store = _ProfilingStore(Path(folder) / "profile")
        for _ in range(rounds + 1):
            decode_gaussians(data, store, threads=1)
        events = json.loads(Path(store.session.end_profiling()).read_text())
    nodes = [event for event in events if event["name"].endswith("_kernel_time")]
    each = len(nodes) // (rounds + 1)
    return [_by_kind(nodes[at : at + each]) for at in range(each, len(nodes), each)]  # the first one warms up


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


def _milliseconds(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    chosen = grouped((row for row in rows if row.study == "parts"), "subject")
    return {name: {row.way: 1e3 * row.costs["seconds"] for row in members} for (name,), members in chosen.items()}


def plot_parts(path: Path, rows: Sequence[Row]) -> bool:
    """A bar per work."""
    works = _milliseconds(rows)
    if works:
        save_shares(path, "% of the time on one thread; milliseconds in the bars", works, REST)
    return bool(works)


STAGES = Study(
    "Where the time goes",
    part_rows,
    {"parts": Listing("parts", {"part": said("way"), "seconds": mean("seconds", duration, "costs"),
                                "share": mean("share", percent, "costs")},
                      sections="subject")},
    {"parts": plot_parts},
)  # fmt: skip
