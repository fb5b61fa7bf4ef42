"""Did a change make it faster? Two versions of the code and the physical floor, in interleaved rounds.

Each version works in a process of its own, which is asked for one call at a time: floor, before, after, floor, … . The
floor is what the work needs in any case (`floors`): of encoding each version's own, as versions choose other steps.
Both run this version's tasks (`tasks`) on their own runtime, whose modules must go by the same names.
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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tinysplat_runtime.errors import InputError, TinySplatError

from ..clock import SETTLE_S, find_task
from ..rows import Row
from ..show.tables import duration, format_table
from ..study import Run, Study
from ..subjects.made import made_gaussians

STUDY = "versions"
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
    return Row(STUDY, case.name, "after", {"floors": [name for name, *_ in case.floors]}, costs=costs)


def _ratio(above: Sequence[float], below: Sequence[float]) -> float:
    return statistics.median(a / b for a, b in zip(above, below, strict=True))


def version_table(rows: Sequence[Row]) -> str:
    """A line per case."""
    lines = []
    for row in (row for row in rows if row.study == STUDY):
        floors = ", ".join(f"{name} {duration(row.costs[name])}" for name in row.setting["floors"])
        ratios = [f"{row.costs[name]:.2f}" if name in row.costs else "" for name in
                  ("after / before", "before / floor", "after / floor")]  # fmt: skip
        lines.append([row.subject, duration(row.costs["before"]), duration(row.costs["after"]), *ratios, floors])
    heads = ["", "before", "after", "after / before", "before / floor", "after / floor", "floors"]
    return format_table(heads, lines) if lines else ""


VERSIONS = Study("Two versions", version_rows, {"versions": version_table})
