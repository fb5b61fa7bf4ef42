"""What does it gain to look again? PSNR to held-out photos against the seconds that refinement was given, with bytes.

A window is refined once, for as long as the largest budget says, and stopped on the way at every smaller one: what is
best then is drawn at the window's targets and coded, while the clock of the budget stands. Where a scene has no window
of so many photos, a larger one gives its first.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.refine.stats import RefineStats
from tinysplat_runtime.system.threads import Crew

from ..pictures import Drawing, photo_psnr
from ..rows import Row, grouped
from ..runner import Job, list_jobs
from ..show.plots import Curve, Panel, save_grid
from ..show.tables import decibels, format_table, kilobytes
from ..study import Run, Study

STUDY = "refine"
SECONDS, QUICK_SECONDS = (0, 2, 5, 10, 20, 40), (0, 2)
VIEWS = (3, 4, 6)

LINE_SECONDS = 10
"""Given for the one line that README has."""


def refine_rows(run: Run) -> Iterator[Row]:
    """Every budget of the first windows of three photos and more of the user's scene folders."""
    for job in _jobs(run):
        try:
            yield from _window_rows(job, run)
        except TinySplatError as error:
            run.left_out.append(f"left out {job}: {error}")


def _jobs(run: Run) -> Iterator[Job]:
    """For every scene and number of photos the first windows of so many, or the first photos of larger ones."""
    plan = run.plan()
    jobs, left_out, notes = list_jobs(replace(plan, limit=None))
    run.left_out += [*map(str, left_out), *notes]
    for same in _by_scene(jobs).values():
        for count in plan.views or VIEWS:
            exact = [job for job in same if len(job.window.context) == count]
            larger = [job for job in same if len(job.window.context) > count]
            for job in (exact or larger)[: plan.limit]:
                yield replace(job, window=replace(job.window, context=job.window.context[:count]))


def _by_scene(jobs: Sequence[Job]) -> dict[tuple[str, str], list[Job]]:
    scenes: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        scenes.setdefault((job.source.name, job.model), []).append(job)
    return scenes


def _window_rows(job: Job, run: Run) -> Iterator[Row]:
    from tinysplat_runtime.refine.refine import MAX_STEPS, Refining

    case = job.case(run.runtime)
    if case.shots is None or case.shots.scene is None:
        return
    profile = (run.options.profiles or (DEFAULT_PROFILE,))[0]
    stats, given_to = RefineStats(), (find_profile(profile), 0.0, Crew(run.threads).map)
    next(Refining(case.gaussians, case.shots.scene, *given_to).advance(1, math.inf), None)  # compiles what it needs
    start = time.perf_counter()
    refining = Refining(case.gaussians, case.shots.scene, *given_to, stats)
    spent = time.perf_counter() - start
    for given in QUICK_SECONDS if run.quick else SECONDS:
        start = time.perf_counter()
        for _ in refining.advance(MAX_STEPS, start + given - spent):
            pass
        better = refining.result() if given else case.gaussians
        spent += time.perf_counter() - start if given else 0.0
        data = run.runtime.compress(better, profile, drop_invalid=True)
        drawings = {"psnr": Drawing(run.threads), "psnr_defined": run.drawing}
        found = {name: photo_psnr(better, case.cameras, case.shots.targets.images, drawn)
                 for name, drawn in drawings.items()}  # fmt: skip
        figures = {**found, "bytes": len(data), "steps": stats.steps, "kept": stats.kept}
        setting = {"views": len(case.gaussians.cameras), "kind": job.window.kind, "model": job.model,
                   "profile": profile, "given": given}  # fmt: skip
        yield Row(STUDY, f"{job.source.name} {job.window}", f"{given} s", setting, figures,
                  {"seconds": spent if given else 0.0})  # fmt: skip


def refine_table(rows: Sequence[Row]) -> str:
    """A line per number of photos and budget: means over windows."""
    lines = []
    for (views, given), members in grouped([row for row in rows if row.study == STUDY], "views", "given").items():
        figures = [row.figures for row in members]
        keys = ("psnr", "psnr_defined", "bytes", "steps", "kept")
        psnr, defined, size, steps, kept = (statistics.fmean(f[key] for f in figures) for key in keys)
        cells = [decibels(psnr), decibels(defined), kilobytes(size), f"{steps:.1f}", f"{kept:.1f}"]
        lines.append([str(views), f"{given} s", str(len(members)), *cells])
    heads = ["photos", "given", "windows", "dB to held-out photos", "as 3DGS defines", "KB", "steps", "kept"]
    return format_table(heads, lines) if lines else ""


def refine_plot(path: Path, rows: Sequence[Row]) -> bool:
    """dB against the seconds that were given, and against bytes: a line per number of photos, means over windows."""
    by_time: list[Curve] = []
    by_bytes: list[Curve] = []
    for (views,), members in grouped([row for row in rows if row.study == STUDY], "views").items():
        means = {
            given: tuple(statistics.fmean(row.figures[key] for row in same) for key in ("psnr", "bytes"))
            for (given,), same in grouped(members, "given").items()
        }
        name = f"{views} photos"
        by_time.append(Curve(name, [(given, psnr) for given, (psnr, _) in means.items()]))
        by_bytes.append(Curve(name, [(size / 1000, psnr) for psnr, size in means.values()]))
    if not by_time:
        return False
    y_label = "dB to held-out photos"
    save_grid(path, "Refinement", [[Panel("by time", "seconds given", y_label, by_time, log=""),
                                    Panel("by size", "KB", y_label, by_bytes, log="")]])  # fmt: skip
    return True


def refine_line(rows: Sequence[Row]) -> str:
    """What a page says of it in a line: dB before and after by number of photos, after the budget of `LINE_SECONDS`."""
    parts = []
    for (views,), members in grouped([row for row in rows if row.study == STUDY], "views").items():
        by_time = {given: same for (given,), same in grouped(members, "given").items()}
        if not {0, LINE_SECONDS} <= by_time.keys():
            continue
        before, after = (statistics.fmean(row.figures["psnr"] for row in by_time[given]) for given in (0, LINE_SECONDS))
        parts.append(f"{views} photos {decibels(before)} → {decibels(after)} dB")
    return f"{LINE_SECONDS} s: {', '.join(parts)}" if parts else ""


REFINE = Study("Refinement", refine_rows, {STUDY: refine_table, f"{STUDY} line": refine_line}, {STUDY: refine_plot})
