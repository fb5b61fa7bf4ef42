"""What does it gain to look again? PSNR to held-out photos against the seconds that refinement was given, with bytes.

Every row is one call of `Runtime.refine` on a network's Gaussians of a window of a scene folder, with so many seconds
at most, and the bytes of what came of it. Steps taken and the step that the check kept stand beside.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.refine.stats import RefineStats

from ..clock import timed
from ..pictures import photo_psnr
from ..rows import Row, grouped
from ..runner import Job, list_jobs
from ..show.plots import Curve, Panel, save_grid
from ..show.tables import decibels, format_table, kilobytes
from ..study import Run, Study

STUDY = "refine"
SECONDS, QUICK_SECONDS = (0, 2, 5, 10, 20, 40), (0, 2)
VIEWS = (3, 4, 6)


def refine_rows(run: Run) -> Iterator[Row]:
    """Every budget of the first windows of three photos and more of the user's scene folders."""
    jobs, left_out, notes = list_jobs(run.plan(views=VIEWS))
    run.left_out += [*map(str, left_out), *notes]
    for job in jobs:
        try:
            yield from _window_rows(job, run)
        except TinySplatError as error:
            run.left_out.append(f"left out {job}: {error}")


def _window_rows(job: Job, run: Run) -> Iterator[Row]:
    case = job.case(run.runtime)
    if case.shots is None or case.shots.scene is None:
        return
    profile = (run.options.profiles or (DEFAULT_PROFILE,))[0]
    for seconds in QUICK_SECONDS if run.quick else SECONDS:
        stats, found = RefineStats(), [case.gaussians]

        def refine(seconds: float = seconds, stats: RefineStats = stats, found: list = found) -> None:
            scene = case.shots.scene if case.shots else None
            assert scene is not None
            found[0] = run.runtime.refine(case.gaussians, scene, seconds=seconds, profile=profile, stats=stats)

        wall, cpu = timed(refine) if seconds else (0.0, 0.0)
        psnr = photo_psnr(found[0], case.cameras, case.shots.targets.images, run.drawing)
        data = run.runtime.compress(found[0], profile, drop_invalid=True)
        figures = {"psnr": psnr, "bytes": len(data), "steps": stats.steps, "kept": stats.kept}
        setting = {"views": len(case.gaussians.cameras), "kind": job.window.kind, "model": job.model,
                   "profile": profile, "given": seconds}  # fmt: skip
        yield Row(STUDY, f"{job.source.name} {job.window}", f"{seconds} s", setting, figures,
                  {"seconds": wall, "cpu_seconds": cpu})  # fmt: skip


def refine_table(rows: Sequence[Row]) -> str:
    """A line per number of photos and budget: means over windows."""
    lines = []
    for (views, given), members in grouped([row for row in rows if row.study == STUDY], "views", "given").items():
        figures = [row.figures for row in members]
        psnr, size, kept = (statistics.fmean(f[key] for f in figures) for key in ("psnr", "bytes", "kept"))
        cells = [decibels(psnr), kilobytes(size), f"{kept:.1f}"]
        lines.append([str(views), f"{given} s", str(len(members)), *cells])
    heads = ["photos", "given", "windows", "dB to held-out photos", "KB", "steps kept"]
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


REFINE = Study("Refinement", refine_rows, {STUDY: refine_table}, {STUDY: refine_plot})
