"""Where does the time go, and did a change make it faster?

Parts of decoding, encoding, frames and the synthesis graph, on one thread, are those that the runtime names
(`system.stopwatch.part`): a part's time is its own, less that of parts within it; what no part takes is `rest`. The
graph's operators are onnxruntime's own profile; the stages of encoding are those of `--report`. Medians of the rounds.

Two versions of the code and the physical floor run in interleaved rounds: each version works in a process of its own,
which is asked for one call at a time: floor, before, after, floor, … . The floor is what the work needs in any case
(`tasks`): of encoding each version's own, as versions choose other steps. Both run this version's tasks on their own
runtime, whose modules must go by the same names.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import onnxruntime as ort

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.decoder import decode_gaussians
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.graphs.inference import Graph, GraphStore
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.system.stopwatch import watched_parts

from ..clock import SETTLE_S, find_task
from ..rows import Row, grouped
from ..show.plots import save_shares
from ..show.tables import Cell, Listing, duration, mean, percent, said
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


# ---- two versions -------------------------------------------------------------------------------------------------

ROOT = Path(__file__).parents[3]

Task = tuple[str, ...]
"""Name of a function in `tasks`, and its arguments."""


@dataclass(frozen=True)
class Case:
    """One line: a task, and what is its floor; `own_floors` where each version is held to its own."""

    name: str
    task: Task
    floors: tuple[Task, ...] = ()
    own_floors: bool = False


def cases(folder: Path, run: Run) -> Iterator[Case]:
    """Decoding, encoding, frames and a cold start; files are coded by this version."""
    shapes = ((2, 128, 128),) if run.quick else ((2, 256, 256), (16, 256, 256), (6, 512, 960))
    first = None
    for shape in shapes:
        path = folder / f"{'x'.join(map(str, shape))}.tsplat"
        path.write_bytes(run.runtime.compress(made_gaussians(*shape, 3), drop_invalid=True))
        first = first or path
        for threads in map(str, run.thread_counts):
            name = f"decode {'×'.join(map(str, shape))}, {threads} threads"
            yield Case(name, ("decode", str(path), threads), (("libavcodec", str(path), threads), ("fill", str(path))))
    made, all_threads = f"network-like:{'x'.join(map(str, shapes[0]))}", str(run.threads)
    for profile in ("balanced",) if run.quick else ("fast", "balanced", "paper"):
        encode = (made, profile, all_threads)
        yield Case(f"encode {profile} {made}", ("encode", *encode), (("libx265", *encode),), own_floors=True)
    pictures = (("surface:2x128x128", "128x128"),) if run.quick else (
        ("surface:2x256x256", "256x256"), ("surface:2x256x256", "512x512"), ("surface:4x512x512", "540x960"),
    )  # fmt: skip
    for scene, size in pictures:
        for way in ("numpy", "compiled"):
            for threads in map(str, run.thread_counts):
                name = f"render {scene} at {size}, {way}, {threads} threads"
                yield Case(name, ("render", scene, size, way, threads), (("exponentials", scene, size),))
    yield Case("tinysplat decode, process start to file", ("start", str(first), str(folder / "out.npz")))


class Worker:
    """A process with one version of the runtime and this version's tasks."""

    def __init__(self, checkout: Path) -> None:
        """Start it; InputError where there is no such checkout."""
        if not (checkout / "runtime").is_dir():
            raise InputError("no checkout of this project", where=str(checkout))
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(map(str, (checkout / "runtime", ROOT))),
            "TINYSPLAT_MODELS": str(checkout / "models"),
        }
        command = [sys.executable, "-c", f"from {__name__} import work; work()"]
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=checkout
        )

    def seconds(self, task: Task) -> float:
        """Of one call; TinySplatError where the process ended."""
        assert self._process.stdin is not None and self._process.stdout is not None
        print(json.dumps(task), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise TinySplatError(f"a version could not do '{task[0]}'; its last words are above", where="versions")
        return float(line)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def work() -> None:
    """What a worker runs: answer requests on standard input, JSON arrays of a task, with the seconds of a call."""
    calls: dict[str, Callable[[], Any]] = {}
    for line in sys.stdin:
        if line not in calls:
            name, *arguments = json.loads(line)
            calls[line] = find_task(f"tinysplat.measure.tasks.{name}")(*arguments)
            calls[line]()
        time.sleep(SETTLE_S)
        start = time.perf_counter()
        result = calls[line]()
        seconds = time.perf_counter() - start
        del result
        print(seconds, flush=True)


def version_rows(run: Run) -> Iterator[Row]:
    """A row per case: milliseconds of both versions and floors, and ratios taken round by round."""
    if run.options.before is None:
        raise InputError("needs --before CHECKOUT of the version to compare with", where="versions")
    rounds = run.options.rounds or (3 if run.quick else 9)
    with tempfile.TemporaryDirectory() as folder:
        workers = [Worker(checkout.resolve()) for checkout in (run.options.before, ROOT)]
        try:
            for case in cases(Path(folder), run):
                yield _compared(case, workers, rounds)
        finally:
            for worker in workers:
                worker.close()


def _compared(case: Case, workers: Sequence[Worker], rounds: int) -> Row:
    before, after = workers
    times: dict[str, list[float]] = {}
    for _ in range(rounds + 1):
        for floor in case.floors:
            times.setdefault(floor[0], []).append(after.seconds(floor))
        if case.own_floors:
            times.setdefault("floor before", []).append(before.seconds(case.floors[0]))
        times.setdefault("before", []).append(before.seconds(case.task))
        times.setdefault("after", []).append(after.seconds(case.task))
    times = {name: values[1:] for name, values in times.items()}  # the first round warms up
    costs = {name: statistics.median(values) for name, values in times.items()}
    costs["after / before"] = _ratio(times["after"], times["before"])
    if case.floors:
        own = times[case.floors[0][0]]
        costs["before / floor"] = _ratio(times["before"], times.get("floor before", own))
        costs["after / floor"] = _ratio(times["after"], own)
    return Row("versions", case.name, "after", {"floors": [name for name, *_ in case.floors]}, costs=costs)


def _ratio(above: Sequence[float], below: Sequence[float]) -> float:
    return statistics.median(a / b for a, b in zip(above, below, strict=True))


def _ratio_of(name: str) -> Cell:
    return lambda rows: f"{rows[0].costs[name]:.2f}" if name in rows[0].costs else ""


def _floors(rows: Sequence[Row]) -> str:
    return ", ".join(f"{name} {duration(rows[0].costs[name])}" for name in rows[0].setting["floors"])


STAGES = Study(
    "Where the time goes",
    part_rows,
    {"parts": Listing("parts", {"part": said("way"), "seconds": mean("seconds", duration, "costs"),
                                "share": mean("share", percent, "costs")},
                      sections="subject")},
    {"parts": plot_parts},
)  # fmt: skip
VERSIONS = Study.of(
    "Two versions",
    version_rows,
    Listing(
        "versions",
        {"": said("subject"), **{name: mean(name, duration, "costs") for name in ("before", "after")},
         **{name: _ratio_of(name) for name in ("after / before", "before / floor", "after / floor")},
         "floors": _floors},
    ),
)  # fmt: skip
