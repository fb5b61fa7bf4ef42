"""The one clock: ways to do the same work, timed in interleaved rounds (A B C A B C …), so that a machine's mood falls
on all alike; and the peak memory of a piece of work in a process of its own.

The first round warms up and is not counted; its results are what the figures are taken from. Wall-clock medians come
with their quartiles and with the CPU seconds of this process and its children, which neighbours on a shared machine
disturb less.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.stopwatch import peak_rss_bytes

from .rows import Row

Figures = dict[str, Any]

PEAK_TIMEOUT_S = 3600

SETTLE_S = 0.03
"""Idle threads of a BLAS spin for about 20 ms after their work; a call begins when they have stopped."""

Times = tuple[float, float]
"""Wall-clock and CPU seconds of one call."""


@dataclass(frozen=True)
class Baseline:
    """Work that a variant is held against, run right after it in every round.

    Attributes:
        name: what it is, for instance `libx265 alone`.
        run: the work.
    """

    name: str
    run: Callable[[], Any]


@dataclass(frozen=True)
class Variant:
    """One way to do some work.

    Attributes:
        name: unique among those compared.
        run: the work that is timed.
        figures: errors and bytes of `run`'s result: all that two runs on one machine must agree on exactly.
        setting: what sets it apart, for tables and plots.
        threads: how many it may use.
        baseline: work in whose units its time is given too.
    """

    name: str
    run: Callable[[], Any]
    figures: Callable[[Any], Figures] = lambda _: {}
    setting: Mapping[str, Any] = field(default_factory=dict)
    threads: int = 1
    baseline: Baseline | None = None


@dataclass(frozen=True)
class Effort:
    """How long to measure.

    Attributes:
        rounds: counted rounds at most.
        budget_s: no further round once variants have taken this long, but `least` are done in any case.
        least: counted rounds at least.
    """

    rounds: int
    budget_s: float = float("inf")
    least: int = 3


def measure(study: str, subject: str, variants: Sequence[Variant], effort: Effort) -> list[Row]:
    """A row per variant, in their order; one that cannot work is a row that says why, behind the others.

    `costs` are `seconds`, `low`, `high` (median and quartiles), `cpu` and `rounds`; with a baseline also
    `baseline_seconds`, and `ratio` and `cpu_ratio`, medians over rounds of the variant's time by its baseline's.
    """
    figures, refused = [], []
    for variant in variants:
        try:
            figures.append(variant.figures(variant.run()))
        except TinySplatError as error:
            refused.append(Row(study, subject, variant.name, variant.setting, note=str(error)))
    variants = [variant for variant in variants if all(row.way != variant.name for row in refused)]
    times: list[list[Times]] = [[] for _ in variants]
    base_times: list[list[Times]] = [[] for _ in variants]
    gc.freeze()  # so that collecting before every call looks at what the calls made, not at all of torch
    start = time.perf_counter()
    for done in range(effort.rounds):
        if done >= effort.least and time.perf_counter() - start > effort.budget_s:
            break
        for i, variant in enumerate(variants):
            times[i].append(timed(variant.run))
            if variant.baseline is not None:
                base_times[i].append(timed(variant.baseline.run))
    gc.unfreeze()
    rows = []
    for variant, figured, own, base in zip(variants, figures, times, base_times, strict=True):
        setting, costs = {**variant.setting, "threads": variant.threads}, summarised(own)
        if variant.baseline is not None:
            setting["baseline"] = variant.baseline.name
            ratios = [statistics.median(a[i] / b[i] for a, b in zip(own, base, strict=True)) for i in (0, 1)]
            costs |= {"baseline_seconds": summarised(base)["seconds"], "ratio": ratios[0], "cpu_ratio": ratios[1]}
        rows.append(Row(study, subject, variant.name, setting, figured, costs))
    return [*rows, *refused]


def timed(run: Callable[[], Any]) -> Times:
    """Time one call, without the garbage collector."""
    gc.collect()
    gc.disable()
    time.sleep(SETTLE_S)
    try:
        wall, cpu = time.perf_counter(), _cpu_seconds()
        run()
        return time.perf_counter() - wall, _cpu_seconds() - cpu
    finally:
        gc.enable()


def summarised(times: Sequence[Times]) -> dict[str, float]:
    """Medians and quartiles of one variant's rounds."""
    walls, cpus = zip(*times, strict=True)
    low, _, high = statistics.quantiles(walls, n=4, method="inclusive") if len(walls) > 1 else [walls[0]] * 3
    return {
        "seconds": statistics.median(walls),
        "low": low,
        "high": high,
        "cpu": statistics.median(cpus),
        "rounds": len(walls),
    }


def _cpu_seconds() -> float:
    """CPU seconds of this process and of the children that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


# ---- memory --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Peak:
    """What a child measured.

    Attributes:
        total: largest resident memory while it worked, its input and libraries included.
        before: resident memory when the work began.
    """

    total: int
    before: int


def measure_peak(task: str, *arguments: object) -> Peak:
    """Peak memory of a piece of work in a fresh process.

    Args:
        task: dotted name of a function of strings, such as `tinysplat.measure.studies.growth.draw_cloud`, that loads
            what is needed and returns the work as a call.
        arguments: the strings.

    Raises:
        TinySplatError: the child failed; its last line says why.
    """
    command = [sys.executable, "-m", __name__, task, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PEAK_TIMEOUT_S)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise TinySplatError(lines[-1], where=f"peak memory of {task}")
    return Peak(**json.loads(done.stdout))


def find_task(dotted: str) -> Callable[..., Callable[[], Any]]:
    """The function of a dotted name."""
    module, _, name = dotted.rpartition(".")
    return getattr(importlib.import_module(module), name)


def reset_high_water_mark() -> None:
    """From here on, `high_water_mark` says what is resident from here on; on Linux, elsewhere nothing happens."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def high_water_mark() -> int:
    """Peak resident memory of this process, bytes.

    On Linux `VmHWM` of /proc/self/status: `ru_maxrss` would start at the parent's size, which exec hands down.
    """
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024
    return peak_rss_bytes()


def _child(task: str, *arguments: str) -> None:
    """Do one task in this process and print its `Peak` as JSON."""
    work = find_task(task)(*arguments)
    reset_high_water_mark()
    before = high_water_mark()
    work()
    print(json.dumps({"total": high_water_mark(), "before": before}))


if __name__ == "__main__":
    _child(*sys.argv[1:])
