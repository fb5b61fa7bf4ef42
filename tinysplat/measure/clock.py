"""The one clock: ways to do the same work, timed in interleaved rounds (A B C A B C …), so that a machine's mood falls
on all alike; and seconds and peak memory of a piece of work in a process of its own.

The first round warms up and is not counted; its results are what the figures are taken from. Wall-clock medians come
with the CPU seconds of this process and its children, which neighbours on a shared machine disturb less.
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
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.stopwatch import peak_rss_bytes

from .rows import Row

Figures = dict[str, Any]

TIMEOUT_S = 3600
"""Of work in a process of its own."""

LEAST_ROUNDS = 3

SETTLE_S = 0.03
"""Idle threads of a BLAS spin for about 20 ms after their work; a call begins when they have stopped."""

T = TypeVar("T")
Times = tuple[float, float]
"""Wall-clock and CPU seconds of one call."""


@dataclass(frozen=True)
class Variant:
    """One way to do some work.

    Attributes:
        name: unique among those compared.
        run: the work that is timed.
        figures: errors and bytes of `run`'s result: all that two runs on one machine must agree on exactly.
        setting: what sets it apart, for tables and plots.
    """

    name: str
    run: Callable[[], object]
    figures: Callable[[Any], Figures] = lambda _: {}
    setting: Mapping[str, Any] = field(default_factory=dict)


def measure(
    study: str, subject: str, variants: Sequence[Variant], rounds: int, budget_s: float = float("inf")
) -> list[Row]:
    """A row per variant, in their order, of so many counted rounds, or of fewer (`LEAST_ROUNDS`) that take so long.

    `costs` are `seconds` and `cpu` (medians), and `rounds`.

    Raises:
        TinySplatError: a variant cannot work.
    """
    figures = [variant.figures(variant.run()) for variant in variants]
    times: list[list[Times]] = [[] for _ in variants]
    gc.freeze()  # so that collecting before every call looks at what the calls made, not at all of torch
    start = time.perf_counter()
    for done in range(rounds):
        if done >= LEAST_ROUNDS and time.perf_counter() - start > budget_s:
            break
        for variant, own in zip(variants, times, strict=True):
            own.append(timed(variant.run))
    gc.unfreeze()
    rows = []
    for variant, figured, own in zip(variants, figures, times, strict=True):
        seconds, cpu = (statistics.median(one[i] for one in own) for i in (0, 1))
        costs = {"seconds": seconds, "cpu": cpu, "rounds": len(own)}
        rows.append(Row(study, subject, variant.name, variant.setting, figured, costs))
    return rows


def timed(run: Callable[[], object]) -> Times:
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


def cpu_of(run: Callable[[], T]) -> tuple[T, float]:
    """What one call gives, and the CPU seconds that it takes."""
    start = _cpu_seconds()
    return run(), _cpu_seconds() - start


def _cpu_seconds() -> float:
    """CPU seconds of this process and of the children that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


# ---- in a process of its own ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Taken:
    """What a piece of work took in a fresh process.

    Attributes:
        total: largest resident memory in bytes while it worked, its input and libraries included.
        before: resident memory in bytes when the work began.
        seconds, cpu: of the work, on the clock and of all its threads.
        figures: what the work returned of itself.
    """

    total: int
    before: int
    seconds: float
    cpu: float
    figures: Figures


def measure_apart(task: str, *arguments: object) -> Taken:
    """Memory and seconds of a piece of work in a fresh process.

    Args:
        task: dotted name of a function of strings, such as `tinysplat.measure.studies.growth.draw_cloud`, that loads
            what is needed and returns the work as a call, which returns figures or nothing.
        arguments: the strings.

    Raises:
        TinySplatError: the process failed, and its last line says why, or took longer than `TIMEOUT_S`.
    """
    command = [sys.executable, "-m", __name__, task, *map(str, arguments)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise TinySplatError(f"took more than {TIMEOUT_S} s", where=task) from None
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise TinySplatError(lines[-1], where=task)
    return Taken(**json.loads(done.stdout))


def _high_water_mark() -> int:
    """Peak resident memory of this process, bytes.

    On Linux `VmHWM` of /proc/self/status: `ru_maxrss` would start at the parent's size, which exec hands down.
    """
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024
    return peak_rss_bytes()


def _child(task: str, *arguments: str) -> None:
    """Do one task in this process and print what it took as JSON."""
    module, _, name = task.rpartition(".")
    work = getattr(importlib.import_module(module), name)(*arguments)
    with contextlib.suppress(OSError):  # not on Linux: the peak of loading counts too
        Path("/proc/self/clear_refs").write_text("5")
    before, start = _high_water_mark(), (time.perf_counter(), time.process_time())
    figures = work() or {}
    seconds, cpu = time.perf_counter() - start[0], time.process_time() - start[1]
    print(json.dumps(asdict(Taken(_high_water_mark(), before, seconds, cpu, figures))))


if __name__ == "__main__":
    _child(*sys.argv[1:])
