"""Many windows: what is already measured, the rest spread over processes, what fails left out with its reason."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.voice import Voice

from ..workers import run_here, run_processes
from .machine import describe_machine
from .quality import GROUP, Quality, mean_of_rows, mean_of_scenes, record
from .rows import Row, RowFile, grouped
from .subjects.cases import LeftOut, Source, WindowJob


@dataclass(frozen=True)
class RunPlan:
    """Which windows to measure.

    Attributes:
        sources: scenes.
        models: networks.
        size: (height, width) of photos.
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
        of_kind = [window for window in windows if not plan.kinds or window.kind in plan.kinds]
        chosen = [window for window in of_kind if not plan.views or len(window.context) in plan.views][: plan.limit]
        if windows and not chosen:
            have = ", ".join(sorted({f"{w.kind} with {len(w.context)} views" for w in windows}))
            notes.append(f"{source.name}: no window of the wanted kind and number of views; it has {have}")
        jobs += [WindowJob(source, window, model, plan.size) for model in plan.models for window in chosen]
    return jobs, left_out, notes


def run_jobs(
    plan: RunPlan, quality: Quality, store: RowFile, *, threads: int = 1, processes: int = 1, quiet: bool = True
) -> RunOutcome:
    """Measure what a plan asks for, keeping what is already there; a window's rows are stored as it ends.

    Args:
        plan, quality, store: which windows, what is done with each, and where rows stand.
        threads, processes: threads of each process, and how many windows are measured at a time.
        quiet: show no progress bar.

    Raises:
        ModelError: there is no such network, or it breaks its contract.
    """
    jobs, left_out, notes = list_jobs(plan)
    for model in plan.models:
        _runtime(threads).store.network(model)  # a wrong model is one error, not one per window
    wanted = {job: quality.wanted(job) for job in jobs}
    known = {row.key for rows in wanted.values() for row in rows if store.find(row)}
    missing = ((job, [row for row in rows if row.key not in known]) for job, rows in wanted.items())
    pending = [(job, rows) for job, rows in missing if rows]
    measure = partial(_measured, quality, threads)
    is_alone = processes == 1 or len(pending) == 1
    outcomes = run_here(pending, measure) if is_alone else run_processes(pending, measure, processes, attempts=1)
    failed: dict[WindowJob, LeftOut] = {}
    for outcome in Voice(quiet).progress("windows", outcomes, total=len(pending)):
        for row in outcome.record or ():
            store.add(row)
        if outcome.error is not None:
            failed[outcome.job[0]] = LeftOut(str(outcome.job[0]), outcome.error)
    left_out += [failed[job] for job in jobs if job in failed]
    rows = [row for job in jobs for row in map(store.find, wanted[job]) if row is not None]
    return RunOutcome(rows, left_out, notes, len(known))


@lru_cache(maxsize=1)
def _runtime(threads: int) -> Runtime:
    """This process's, which keeps graphs from window to window."""
    return Runtime(threads=threads)


def _measured(quality: Quality, threads: int, pending: tuple[WindowJob, Sequence[Row]]) -> list[Row]:
    """A window's rows; InputError says what is wrong with it."""
    try:
        return list(quality.measure(*pending, _runtime(threads)))
    except OSError as error:
        raise InputError(str(error)) from None
    except MemoryError:
        raise InputError("not enough memory; a smaller --size or fewer --jobs need less") from None


def document(outcome: RunOutcome, lpips: str, threads: int, processes: int) -> JsonObject:
    """The object that `eval --json` writes.

    `scenes` has one entry per window and coding, `mean` the means over all of them, and `groups` the means of those
    that compare: of one kind, number of views, model, profile, Q_g and size.
    """
    groups: list[JsonObject] = []
    for values, rows in grouped(outcome.rows, *GROUP).items():
        identity = dict(zip(GROUP, values, strict=True))
        height, width = identity.pop("size")
        means = {"mean": mean_of_rows(rows), "mean_of_scenes": mean_of_scenes(rows)}
        groups.append({**identity, "height": height, "width": width, "windows": len(rows), **means})
    return {
        "scenes": [record(row) for row in outcome.rows],
        "mean": mean_of_rows(outcome.rows),
        "groups": groups,
        "left_out": [asdict(entry) for entry in outcome.left_out],
        "lpips": lpips,
        "threads": threads,
        "processes": processes,
        "environment": describe_machine(),
    }
