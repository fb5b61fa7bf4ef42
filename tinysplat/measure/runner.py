"""Many windows: what is already measured, the rest spread over processes, what fails left out with its reason."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Protocol

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.progress import progress

from ..children import settle_worker, starting_workers
from .rows import Row, RowFile, code_fingerprint, digest, model_fingerprint
from .subjects.cases import FILE, Case, LeftOut, Source, Window


@dataclass(frozen=True)
class RunPlan:
    """Which windows to measure.

    Attributes:
        sources: scenes.
        models: networks; ignored for Gaussian files.
        size: (height, width) of photos; Gaussian files keep their own.
        kinds: kinds of window wanted; empty for all.
        views: numbers of context views wanted; empty for all.
        limit: windows per scene, or None for all.
    """

    sources: Sequence[Source]
    models: Sequence[str]
    size: tuple[int, int] = (256, 256)
    kinds: Sequence[str] = ()
    views: Sequence[int] = ()
    limit: int | None = None


@dataclass(frozen=True)
class WindowJob:
    """A window and a model."""

    source: Source
    window: Window
    model: str
    size: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.source.name} {self.window}, {self.model}"

    def case(self, runtime: Runtime) -> Case:
        """The window brought to Gaussians; TinySplatError names what is at fault."""
        return self.source.case(self.window, self.model, self.size, runtime)

    def stamp(self, *options: object) -> str:
        """Changes when anything that the window's figures depend on does: photos, network, code, libraries, options."""
        model = model_fingerprint(self.model) if self.source.needs_network else ""
        try:
            source = self.source.fingerprint(self.window)
        except (TinySplatError, OSError):
            source = ""  # the fault of the window, which will say so when it is measured
        return digest(source, model, self.size, code_fingerprint(), *options)


class Work(Protocol):
    """What is done with a window. Picklable where more than one process does it."""

    def wanted(self, job: WindowJob) -> list[Row]:
        """Its rows with neither figures nor costs: what is to be measured."""

    def measure(self, job: WindowJob, wanted: Sequence[Row], runtime: Runtime) -> Iterator[Row]:
        """Some of them, measured."""


@dataclass(frozen=True)
class RunOutcome:
    """Results in the plan's order.

    Attributes:
        rows: what was measured, and what had been.
        left_out: windows and scenes that could not be measured.
        notes: what is no fault but worth a line, such as scenes without windows of the wanted kind.
        resumed: how many of the rows were there before.
    """

    rows: list[Row]
    left_out: list[LeftOut]
    notes: list[str]
    resumed: int


def list_jobs(plan: RunPlan) -> tuple[list[WindowJob], list[LeftOut], list[str]]:
    """Jobs of a plan, windows and scenes whose index is at fault, and notes."""
    jobs: list[WindowJob] = []
    left_out: list[LeftOut] = []
    notes: list[str] = []
    for source in plan.sources:
        try:
            windows, lost = source.windows()
        except TinySplatError as error:
            left_out.append(LeftOut(source.name, str(error)))
            continue
        left_out += lost
        of_kind = [window for window in windows if not plan.kinds or window.kind in (*plan.kinds, FILE)]
        chosen = [window for window in of_kind if not plan.views or len(window.context) in plan.views][: plan.limit]
        if windows and not chosen:
            have = ", ".join(sorted({f"{w.kind} with {len(w.context)} views" for w in windows}))
            notes.append(f"{source.name}: no window of the wanted kind and number of views; it has {have}")
        models = plan.models if source.needs_network else (source.name,)
        jobs += [WindowJob(source, window, model, plan.size) for model in models for window in chosen]
    return jobs, left_out, notes


def run_jobs(
    plan: RunPlan,
    work: Work,
    store: RowFile,
    *,
    threads: int = 1,
    processes: int = 1,
    quiet: bool = True,
    runtime: Runtime | None = None,
) -> RunOutcome:
    """Measure what a plan asks for, keeping what is already there; rows are stored as they come.

    Args:
        plan, work, store: which windows, what is done with each, and where rows stand.
        threads, processes: threads of each process, and how many windows are measured at a time.
        quiet: show no progress bar.
        runtime: whose opened graphs to use where one process measures; None for an own one.

    Raises:
        ModelError: there is no such network, or it breaks its contract.
        TinySplatError: a process was killed.
    """
    jobs, left_out, notes = list_jobs(plan)
    runtime = runtime or Runtime(threads=threads)
    if any(job.source.needs_network for job in jobs):
        for model in plan.models:
            runtime.store.network(model)  # a wrong model is one error, not one per window
    wanted = {job: work.wanted(job) for job in jobs}
    known = {row.key for rows in wanted.values() for row in rows if store.find(row)}
    pending = {job: [row for row in rows if row.key not in known] for job, rows in wanted.items()}
    pending = {job: rows for job, rows in pending.items() if rows}
    failed: dict[WindowJob, LeftOut] = {}
    results = (
        _in_processes(work, store, pending, threads, processes)
        if processes > 1 and len(pending) > 1
        else ((job, _measured(work, job, rows, runtime, store.add)) for job, rows in pending.items())
    )
    for job, fault in progress(results, len(pending), "windows", quiet=quiet):
        if fault is not None:
            failed[job] = fault
    left_out += [failed[job] for job in jobs if job in failed]
    rows = [row for job in jobs for row in map(store.find, wanted[job]) if row is not None]
    return RunOutcome(rows, left_out, notes, len(known))


def _measured(
    work: Work, job: WindowJob, wanted: Sequence[Row], runtime: Runtime, keep: Callable[[Row], object]
) -> LeftOut | None:
    """Measure and keep one window's rows; what went wrong, or None."""
    try:
        for row in work.measure(job, wanted, runtime):
            keep(row)
    except (TinySplatError, OSError) as error:
        return LeftOut(str(job), str(error))
    except MemoryError:
        return LeftOut(str(job), "not enough memory; a smaller --size or fewer --jobs need less")
    return None


def _in_processes(
    work: Work, store: RowFile, pending: dict[WindowJob, list[Row]], threads: int, processes: int
) -> Iterator[tuple[WindowJob, LeftOut | None]]:
    context = multiprocessing.get_context("spawn")
    count = min(processes, len(pending))
    with ProcessPoolExecutor(count, context, initializer=_start_worker, initargs=(work, threads)) as pool:
        with starting_workers():
            futures = {pool.submit(_in_worker, job, rows): job for job, rows in pending.items()}
        try:
            for future in as_completed(futures):
                rows, fault = future.result()
                for row in rows:
                    store.add(row)
                yield futures[future], fault
        except BrokenProcessPool:
            raise TinySplatError(
                "a process was killed, perhaps for want of memory; the same command goes on where it stopped,"
                " with fewer --jobs in less memory",
                where="eval",
            ) from None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


_worker: tuple[Work, Runtime] | None = None


def _start_worker(work: Work, threads: int) -> None:
    """Set up a process of the pool: it dies with its parent, and at once when interrupted."""
    global _worker
    settle_worker()
    _worker = work, Runtime(threads=threads)


def _in_worker(job: WindowJob, wanted: Sequence[Row]) -> tuple[list[Row], LeftOut | None]:
    assert _worker is not None
    rows: list[Row] = []
    fault = _measured(_worker[0], job, wanted, _worker[1], rows.append)
    return rows, fault
