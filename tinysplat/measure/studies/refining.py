"""What does it gain to look again? PSNR to held-out photos against bytes: the Gaussians of a window of four photos are
coded at several Q_g as the network gives them and as refinement leaves them, and drawn from the files.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.errors import TinySplatError

from ..curves import decibels_at
from ..pictures import photo_psnr
from ..rows import Row, grouped, of_study
from ..runner import WindowJob
from ..show.plots import Axis, Chart, save_grid
from ..show.tables import decibels, format_table
from ..study import Run, Study

CURVES = "refined curves"
CURVE_QPS, QUICK_CURVE_QPS = (-6.0, 2.0, 12.0, 22.0), (0.0, 12.0)
CURVE_VIEWS = (4,)
SIZES_KB = (20, 40, 80, 160, 300)
"""At which the two are compared."""


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
    profile = (run.options.profiles or (DEFAULT_PROFILE,))[0]
    better = run.runtime.refine(case.gaussians, case.shots.scene, profile=profile)
    for way, gaussians in (("unrefined", case.gaussians), ("refined", better)):
        for qp in run.options.qps or (QUICK_CURVE_QPS if run.quick else CURVE_QPS):
            data = run.runtime.compress(gaussians, profile, qp, drop_invalid=True)
            psnr = photo_psnr(run.runtime.decompress(data), case.cameras, case.shots.targets.images, run.threads)
            setting = {
                "scene": job.source.name,
                "views": len(case.gaussians.cameras),
                "model": job.model,
                "profile": profile,
                "qp": qp,
            }
            yield Row(CURVES, f"{job.source.name} {job.window}", way, setting, {"bytes": len(data), "psnr": psnr})


def curve_table(rows: Sequence[Row]) -> str:
    """A line per size: dB that files of at most that size reach without and with refinement, means over windows."""
    windows = [
        {
            way: [(row.figures["bytes"], row.figures["psnr"]) for row in same]
            for (way,), same in grouped(members, "way").items()
        }
        for members in grouped(of_study(rows, CURVES), "subject").values()
    ]
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


REFINED = Study("Refinement by size", curve_rows, {CURVES: curve_table}, {CURVES: curve_plot})
