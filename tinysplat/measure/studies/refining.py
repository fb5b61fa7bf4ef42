"""What does it gain to look again? PSNR to held-out photos against seconds and against bytes.

By seconds: a window is refined once, for as long as the largest budget says, and stopped on the way at every smaller
one: what is best then is drawn at the window's targets and coded, while the clock of the budget stands. Where a scene
has no window of so many photos, a larger one gives its first.

By bytes: the Gaussians of a window of four photos are coded at several Q_g as the network gives them and as refinement
leaves them, and drawn from the files.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.refine.stats import RefineStats
from tinysplat_runtime.system.threads import Crew

from ..curves import decibels_at
from ..pictures import Drawing, photo_psnr
from ..rows import Row, grouped, of_study
from ..runner import WindowJob
from ..show.plots import Axis, Chart, Curve, Panel, save_grid
from ..show.tables import decibels, format_table, kilobytes
from ..study import Run, Study
from ..subjects.cases import Case

STUDY = "refine"
SECONDS, QUICK_SECONDS = (0, 2, 5, 10, 20, 40), (0, 2)
VIEWS = (3, 4, 6)

CURVES = "refined curves"
CURVE_QPS, QUICK_CURVE_QPS = (-6.0, 2.0, 12.0, 22.0), (0.0, 12.0)
CURVE_VIEWS = (4,)
SIZES_KB = (20, 40, 80, 160, 300)
"""At which the two are compared."""


def refine_rows(run: Run) -> Iterator[Row]:
    """Every budget of the first windows of three photos and more of the user's scene folders."""
    for job in run.jobs(VIEWS):
        try:
            yield from _window_rows(job, run)
        except TinySplatError as error:
            run.left_out.append(f"left out {job}: {error}")


def _window_rows(job: WindowJob, run: Run) -> Iterator[Row]:
    from tinysplat_runtime.refine.refine import MAX_STEPS, Refining

    case = job.case(run.runtime)
    if case.shots is None or case.shots.scene is None:
        return
    profile = (run.options.profiles or (DEFAULT_PROFILE,))[0]
    stats, given_to = RefineStats(), (find_profile(profile), 0.0, Crew(run.threads).map)
    next(Refining(case.gaussians, case.shots.scene, *given_to).advance(1, math.inf), None)  # compiles what it needs
    start = time.perf_counter()
    refining = Refining(case.gaussians, case.shots.scene, *given_to, stats)
    spent, known = time.perf_counter() - start, dict[int, dict[str, float]]()
    for given in QUICK_SECONDS if run.quick else SECONDS:
        start = time.perf_counter()
        for _ in refining.advance(MAX_STEPS, start + given - spent):
            pass
        better = refining.result() if given else case.gaussians
        spent += time.perf_counter() - start if given else 0.0
        if stats.kept not in known:  # what longer budgets do not make better is measured already
            known[stats.kept] = _figures(better, case, profile, run)
        figures = {**known[stats.kept], "steps": stats.steps, "kept": stats.kept}
        setting = {"views": len(case.gaussians.cameras), "kind": job.window.kind, "model": job.model,
                   "profile": profile, "given": given}  # fmt: skip
        yield Row(STUDY, f"{job.source.name} {job.window}", f"{given} s", setting, figures,
                  {"seconds": spent if given else 0.0})  # fmt: skip


def _figures(gaussians: Gaussians, case: Case, profile: str, run: Run) -> dict[str, float]:
    """dB to held-out photos by either drawing, and bytes."""
    assert case.shots is not None
    drawings, photos = {"psnr": Drawing(run.threads), "psnr_defined": run.drawing}, case.shots.targets.images
    found = {name: photo_psnr(gaussians, case.cameras, photos, drawn) for name, drawn in drawings.items()}
    return {**found, "bytes": len(run.runtime.compress(gaussians, profile, drop_invalid=True))}


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


def curve_rows(run: Run) -> Iterator[Row]:
    """Files of the first windows of four photos, unrefined and refined: once, for Q_g 0, in the default steps."""
    for job in run.jobs(CURVE_VIEWS):
        try:
            yield from _curve_rows(job, run)
        except TinySplatError as error:
            run.left_out.append(f"left out {job}: {error}")


def _curve_rows(job: WindowJob, run: Run) -> Iterator[Row]:
    case = job.case(run.runtime)
    if case.shots is None or case.shots.scene is None:
        return
    profile, drawing = (run.options.profiles or (DEFAULT_PROFILE,))[0], Drawing(run.threads)
    better = run.runtime.refine(case.gaussians, case.shots.scene, profile=profile)
    for way, gaussians in (("unrefined", case.gaussians), ("refined", better)):
        for qp in run.options.qps or (QUICK_CURVE_QPS if run.quick else CURVE_QPS):
            data = run.runtime.compress(gaussians, profile, qp, drop_invalid=True)
            psnr = photo_psnr(run.runtime.decompress(data), case.cameras, case.shots.targets.images, drawing)
            setting = {"scene": job.source.name, "views": len(case.gaussians.cameras), "model": job.model,
                       "profile": profile, "qp": qp}  # fmt: skip
            yield Row(CURVES, f"{job.source.name} {job.window}", way, setting, {"bytes": len(data), "psnr": psnr})


def curve_table(rows: Sequence[Row]) -> str:
    """A line per size: dB that files of at most that size reach without and with refinement, means over windows."""
    windows = [
        {way: [(row.figures["bytes"], row.figures["psnr"]) for row in same]
         for (way,), same in grouped(members, "way").items()}
        for members in grouped(of_study(rows, CURVES), "subject").values()
    ]  # fmt: skip
    lines = []
    for size in SIZES_KB:
        pairs = [[decibels_at(curves[way], 1000 * size) for way in ("unrefined", "refined")] for curves in windows]
        known = [(before, after) for before, after in pairs if before is not None and after is not None]
        if known:
            before, after = (statistics.fmean(values) for values in zip(*known, strict=True))
            gains = [after - before for before, after in known]
            cells = decibels(before), decibels(after), f"{statistics.fmean(gains):+.2f}", f"{min(gains):+.2f}"
            lines.append([str(size), str(len(known)), *cells])
    heads = ["KB", "windows", "unrefined, dB", "refined, dB", "gain", "least gain"]
    return format_table(heads, lines) if lines else ""


_CURVE = Chart(CURVES, "", Axis("bytes", "KB", unit=1e-3), Axis("psnr", "dB to held-out photos"), panel="scene")


def curve_plot(path: Path, rows: Sequence[Row]) -> bool:
    """dB against bytes, a panel per scene, three in a row."""
    panels = _CURVE.panels(rows)
    if panels:
        save_grid(path, "Refinement by size", [panels[i : i + 3] for i in range(0, len(panels), 3)])
    return bool(panels)


REFINE = Study("Refinement", refine_rows, {STUDY: refine_table}, {STUDY: refine_plot})
REFINED = Study("Refinement by size", curve_rows, {CURVES: curve_table}, {CURVES: curve_plot})
