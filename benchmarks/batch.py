"""Throughput of `tinysplat batch` by engine and workers, and a worker killed midway.

    python benchmarks/batch.py MANIFEST --views auto:2 --size 256x256             # scenes a second
    python benchmarks/batch.py MANIFEST --kill ray                                # a log, line by line

Throughput is that of warm workers: the time from the first result of every worker to the last result of all. One JSON
line per run. `--kill` ends the worker of the second result with SIGKILL while it has another scene at hand, and fails
unless every scene is there once, whole.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tinysplat.batch.engines import Outcome, run_processes, run_ray
from tinysplat.batch.jobs import Job, Options, encode, is_done, read_manifest
from tinysplat.batch.run import Engine, run_batch
from tinysplat_runtime.cli.arguments import AutoViews, size, views

ATTEMPTS = 3


def engine_of(name: str, workers: int) -> Engine:
    """An engine that encodes."""
    if name == "ray":
        return partial(run_ray, work=encode, workers=workers, attempts=ATTEMPTS, address=None)
    return partial(run_processes, work=encode, workers=workers, attempts=ATTEMPTS)


def throughput(jobs: Sequence[Job], name: str, workers: int) -> dict[str, Any]:
    """Scenes a second of warm workers."""
    times, seen = [], set()
    warm_at = 0
    start = time.perf_counter()
    for outcome in engine_of(name, workers)(jobs):
        assert outcome.record is not None, outcome.error
        times.append(time.perf_counter() - start)
        seen.add(outcome.record["worker"])
        if len(seen) == workers and not warm_at:
            warm_at = len(times)
    rate = (len(times) - warm_at) / (times[-1] - times[warm_at - 1])
    return {"engine": name, "workers": workers, "scenes": len(jobs), "scenes_per_second": round(rate, 3),
            "first_result_s": round(times[0], 2), "seconds": round(times[-1], 2)}  # fmt: skip


def killing(engine: Engine, jobs: Sequence[Job]) -> Iterator[Outcome]:
    """The engine's outcomes, told as they come; the worker of the second one is killed."""
    start = time.perf_counter()
    for number, outcome in enumerate(engine(jobs), start=1):
        record = outcome.record or {"worker": outcome.error}
        told = f"{outcome.job.name} by worker {record['worker']}, attempt {outcome.attempts}"
        print(f"{time.perf_counter() - start:6.2f} s  {told}", flush=True)
        if number == 2:
            os.kill(record["worker"], signal.SIGKILL)
            print(f"{time.perf_counter() - start:6.2f} s  SIGKILL to worker {record['worker']}", flush=True)
        yield outcome


def kill_test(jobs: Sequence[Job], folder: Path, name: str) -> int:
    """Exit status 0 where every scene is there once, whole, in spite of a worker that is killed."""
    order: list[str] = []

    def engine(left: Sequence[Job]) -> Iterator[Outcome]:
        for outcome in killing(engine_of(name, 2), left):
            order.append(outcome.job.name)
            yield outcome

    document = run_batch(jobs, str(folder), engine, lambda line: None)
    whole = sum(is_done(job, document["scenes"].get(job.name)) for job in jobs)
    repeated = sum(record["attempts"] > 1 for record in document["scenes"].values())
    print(f"{whole} of {len(jobs)} scenes whole, {len(order) - len(set(order))} twice, {repeated} begun again")
    return 0 if whole == len(jobs) == len(order) else 1


def main() -> int:
    """Run; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("--views", type=views, default=AutoViews(2))
    parser.add_argument("--size", type=size, default=(256, 256))
    parser.add_argument("--engines", nargs="+", default=["processes", "ray"], choices=("processes", "ray"))
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--kill", choices=("processes", "ray"))
    args = parser.parse_args()
    auto = args.views.count if isinstance(args.views, AutoViews) else 0
    options = Options(views=None if auto else tuple(args.views), auto=auto, size=args.size)
    with tempfile.TemporaryDirectory() as folder:
        jobs = read_manifest(args.manifest.read_text(), folder, options, str(args.manifest.parent))
        if args.kill:
            return kill_test(jobs, Path(folder), args.kill)
        for name in args.engines:
            for workers in args.workers:
                print(json.dumps(throughput(jobs, name, workers)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
