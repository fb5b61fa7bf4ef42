"""Variants of one stage, timed in interleaved rounds (A B C A B C …), so that a machine's mood falls on all alike.

The first round warms up and is not counted; its results are what the errors are taken from. Wall-clock medians come
with their quartiles and with the CPU seconds of this process and its children, which neighbours on a shared machine
disturb less.
"""

from __future__ import annotations

import gc
import resource
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

Figures = dict[str, float]
Setting = str | int | float | bool


def no_figures(_: Any) -> Figures:
    """For variants that only time is asked of."""
    return {}


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
    """One way to do a stage's work.

    Attributes:
        name: unique within its stage and case.
        run: the work that is timed.
        figures: errors and bytes of `run`'s result: all that two runs on one machine must agree on exactly.
        settings: what sets it apart, for tables and plots.
        threads: how many it may use.
        baseline: work in whose units its time is given too.
    """

    name: str
    run: Callable[[], Any]
    figures: Callable[[Any], Figures] = no_figures
    settings: Mapping[str, Setting] = field(default_factory=dict)
    threads: int = 1
    baseline: Baseline | None = None


@dataclass(frozen=True)
class Seconds:
    """Wall-clock seconds of one call over the counted rounds.

    Attributes:
        median, low, high: median and quartiles.
        cpu: median of the CPU seconds of this process and its children, all threads together.
        rounds: how many were counted.
    """

    median: float
    low: float
    high: float
    cpu: float
    rounds: int


@dataclass(frozen=True)
class Row:
    """One line of a report.

    Attributes:
        stage: what part of the chain.
        case: the input it was measured on.
        variant: the way it was done.
        threads: how many were used.
        settings: what sets the variant apart.
        seconds: None where nothing was run.
        figures: what two runs must agree on.
        ratio: median over rounds of the variant's seconds by its baseline's.
        cpu_ratio: the same of their CPU seconds.
        baseline: the baseline's name and median seconds.
        peak_bytes: largest resident memory while a process of its own did the work.
        note: why a figure is missing, or what to know about it.
    """

    stage: str
    case: str
    variant: str
    threads: int = 1
    settings: Mapping[str, Setting] = field(default_factory=dict)
    seconds: Seconds | None = None
    figures: Figures = field(default_factory=dict)
    ratio: float | None = None
    cpu_ratio: float | None = None
    baseline: tuple[str, float] | None = None
    peak_bytes: int | None = None
    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """A JSON-ready object, without what is empty."""
        return {key: value for key, value in asdict(self).items() if value not in (None, {}, "")}


@dataclass(frozen=True)
class Stage:
    """Variants that are compared on one input."""

    name: str
    case: str
    variants: Sequence[Variant]


@dataclass(frozen=True)
class Effort:
    """How long to measure.

    Attributes:
        rounds: counted rounds at most.
        budget_s: no further round once a stage has taken this long, but `least` are done in any case.
        least: counted rounds at least.
    """

    rounds: int
    budget_s: float
    least: int = 3


def measure(stage: Stage, effort: Effort) -> list[Row]:
    """Run a stage; one row per variant, in their order."""
    figures = [variant.figures(variant.run()) for variant in stage.variants]
    times: list[list[Times]] = [[] for _ in stage.variants]
    base_times: list[list[Times]] = [[] for _ in stage.variants]
    gc.freeze()  # so that collecting before every call looks at what the calls made, not at all of torch
    start = time.perf_counter()
    for done in range(effort.rounds):
        if done >= effort.least and time.perf_counter() - start > effort.budget_s:
            break
        for i, variant in enumerate(stage.variants):
            times[i].append(timed(variant.run))
            if variant.baseline is not None:
                base_times[i].append(timed(variant.baseline.run))
    gc.unfreeze()
    return [_row(stage, variant, figures[i], times[i], base_times[i]) for i, variant in enumerate(stage.variants)]


Times = tuple[float, float]
"""Wall-clock and CPU seconds of one call."""

SETTLE_S = 0.03
"""Idle threads of a BLAS spin for about 20 ms after their work; a call begins when they have stopped."""


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


def _cpu_seconds() -> float:
    """CPU seconds of this process and of the children that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def summarise(times: Sequence[Times]) -> Seconds:
    """Medians and quartiles of one variant's rounds."""
    walls, cpus = zip(*times, strict=True)
    low, _, high = statistics.quantiles(walls, n=4, method="inclusive") if len(walls) > 1 else [walls[0]] * 3
    return Seconds(statistics.median(walls), low, high, statistics.median(cpus), len(walls))


def _row(stage: Stage, variant: Variant, figures: Figures, times: list[Times], base: list[Times]) -> Row:
    row = Row(
        stage.name,
        stage.case,
        variant.name,
        variant.threads,
        dict(variant.settings),
        summarise(times),
        figures,
    )
    if variant.baseline is None:
        return row
    ratios = [statistics.median(a[i] / b[i] for a, b in zip(times, base, strict=True)) for i in (0, 1)]
    return replace(row, ratio=ratios[0], cpu_ratio=ratios[1], baseline=(variant.baseline.name, summarise(base).median))
