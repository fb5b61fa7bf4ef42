"""How many scenes a second does `tinysplat batch` code, by engine and workers; and is all there when a worker is
killed?

Throughput is that of warm workers: the time from the first result of every worker to the last result of all.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from tinysplat.batch.engines import Outcome, run_processes, run_ray
from tinysplat.batch.jobs import Job, encode, is_done, read_manifest
from tinysplat.batch.run import Engine, run_batch
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe.words import AutoViews

from ..rows import Row
from ..show.tables import format_table
from ..study import Run, Study

STUDY = "batch"
ATTEMPTS = 3
ENGINES = ("processes", "ray")


def batch_rows(run: Run) -> Iterator[Row]:
    """A row per engine and number of workers, and one of a worker that is killed; the input is a manifest."""
    if len(run.paths) != 1 or not run.paths[0].is_file():
        raise InputError("needs a manifest, a scene a line, as its one INPUT", where="batch")
    manifest = run.paths[0]
    options = {"views": AutoViews(next(iter(run.options.views), 2)), "size": run.options.size or (256, 256)}
    with tempfile.TemporaryDirectory() as folder:
        jobs = read_manifest(manifest.read_text(), folder, options, str(manifest.parent))
        for name in ("processes",) if run.quick else ENGINES:
            for workers in range(1, run.threads + 1):
                yield _throughput(jobs, name, workers)
        yield _killed(jobs, Path(folder) / "killed")


def _engine(name: str, workers: int) -> Engine:
    if name == "ray":
        return partial(run_ray, work=encode, workers=workers, attempts=ATTEMPTS, address=None)
    return partial(run_processes, work=encode, workers=workers, attempts=ATTEMPTS)


def _throughput(jobs: Sequence[Job], name: str, workers: int) -> Row:
    times, seen, warm_at, start = [], set(), 0, time.perf_counter()
    for outcome in _engine(name, workers)(jobs):
        assert outcome.record is not None, outcome.error
        times.append(time.perf_counter() - start)
        seen.add(outcome.record["worker"])
        if len(seen) == workers and not warm_at:
            warm_at = len(times)
    spent = times[-1] - times[max(warm_at, 1) - 1]
    rate = (len(times) - warm_at) / spent if spent > 0 else float("nan")
    costs = {"scenes_per_second": rate, "first_result": times[0], "seconds": times[-1]}
    return Row(STUDY, f"{len(jobs)} scenes", f"{name}, {workers} workers", {"threads": workers}, costs=costs)


def _killed(jobs: Sequence[Job], folder: Path) -> Row:
    """The worker of the second result is killed while it has another scene at hand."""
    order: list[str] = []

    def engine(left: Sequence[Job]) -> Iterator[Outcome]:
        for outcome in _engine("processes", 2)(left):
            order.append(outcome.job.name)
            if len(order) == 2 and outcome.record is not None:
                os.kill(outcome.record["worker"], signal.SIGKILL)
            yield outcome

    document = run_batch(jobs, str(folder), engine, lambda line: None)
    figures = {
        "scenes": len(jobs),
        "whole": sum(is_done(job, document["scenes"].get(job.name)) for job in jobs),
        "twice": len(order) - len(set(order)),
    }
    return Row(STUDY, f"{len(jobs)} scenes", "a worker killed", figures=figures)


def batch_table(rows: Sequence[Row]) -> str:
    """A line per engine and number of workers."""
    lines = []
    for row in (row for row in rows if row.study == STUDY):
        if row.figures:
            found = f"{row.figures['whole']} of {row.figures['scenes']} whole, {row.figures['twice']} twice"
            lines.append([row.way, found, "", ""])
        else:
            costs = [f"{row.costs[name]:.2f}" for name in ("scenes_per_second", "first_result", "seconds")]
            lines.append([row.way, *costs])
    heads = ["", "scenes a second", "first result, s", "all, s"]
    return format_table(heads, lines) if lines else ""


BATCH = Study("Batch", batch_rows, {"batch": batch_table})
