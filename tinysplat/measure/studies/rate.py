"""What does quality cost in bytes? Rate–distortion of ways to store the same Gaussians, and what each idea of the codec
gains.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians, at cameras that the Gaussians were not made
from where there are some: against pictures of the raw ones, and against photos where these are at hand.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import InputError

from .. import ideas
from ..pictures import Drawing, PictureJudge
from ..rows import Row, grouped
from ..runner import RunPlan, WindowJob, run_jobs
from ..show.curve_tables import TO_PHOTO, TO_RAW, gain_table, group_tables, measured, overview_table
from ..show.plots import Axis, Chart, save_grid
from ..study import Run, Study
from ..subjects.cases import FILE
from ..ways import Way, find_ways

CURVE_QPS: Mapping[str, tuple[float, ...]] = {
    "paper": (-6, 0, 6, 12, 18),
    **dict.fromkeys(("fast", "balanced", "max"), (-4, 2, 8)),
    "photos": (-10, 2, 14),
}
"""Q_g by what it belongs to: each steps around 40 dB, or down to sizes where photos still serve."""

QUICK_QPS = (0.0, 8.0)
IDEA_QPS = (-4.0, 0.0, 4.0)
"""Of the profile with all its ideas; without one, the middle."""

VIEWS, KINDS = (2, 4, 6), ("near", "multi")

# ---- measuring ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class WindowRows:
    """The work on every window: a row per way and setting."""

    study: str
    ways: Sequence[Way]
    targets: int

    def wanted(self, job: WindowJob) -> list[Row]:
        """See `runner.Work`."""
        stamp = job.stamp(self.targets)
        return [replace(_row(self.study, job, way.name, qp), stamp=stamp) for way in self.ways for qp in way.settings]

    def measure(self, job: WindowJob, wanted: Sequence[Row], runtime: Runtime) -> Iterator[Row]:
        """See `runner.Work`."""
        case = job.case(runtime).only(self.targets)
        pictures, ways = PictureJudge(case, Drawing.as_defined(runtime.threads)), {way.name: way for way in self.ways}
        for row in wanted:
            way = ways[row.way]
            refused = way.refuses(case)
            if refused:
                yield replace(row, note=refused)
                continue
            data = way.encode(case, row.setting["qp"])
            yield replace(row, figures=point_figures(way, data, pictures))


def point_figures(way: Way, data: bytes, pictures: PictureJudge) -> dict[str, Any]:
    """Bytes, dB and bytes by class of one file."""
    decoded = way.decode(pictures.case, data)
    return {"bytes": len(data), **pictures.figures(decoded), "classes": dict(way.classes(data))}


def _row(study: str, job: WindowJob, way: str, qp: float) -> Row:
    network = job.model if job.source.needs_network else FILE
    subject = f"{job.source.name} {job.window}"
    return Row(study, subject, way, {"network": network, "views": len(job.window.context), "qp": qp, "size": job.size})


def _plans(run: Run) -> Iterator[RunPlan]:
    """A plan per number of views, so that each number has its share of windows."""
    if not run.sources:
        raise InputError("needs scene folders or Gaussian files as INPUT", where="bench")
    for views in run.options.views or ((2,) if run.quick else VIEWS):
        yield run.plan((views,), KINDS)


def _point_rows(run: Run, study: str, ways: Sequence[Way]) -> Iterator[Row]:
    work = WindowRows(study, ways, 1 if run.quick else run.options.targets)
    for plan in _plans(run):
        outcome = run_jobs(plan, work, run.store, runtime=run.runtime)
        run.left_out += [str(entry) for entry in outcome.left_out]
        yield from outcome.rows


def _ways(run: Run, defaults: Mapping[str, Sequence[float]], other: Sequence[float] = ()) -> list[Way]:
    options = run.options
    profiles = options.profiles or (("balanced", "paper") if run.quick else tuple(PROFILES))
    qps = options.qps or (QUICK_QPS if run.quick else ())
    chosen = {name: qps or defaults.get(name, other) for name in (*profiles, *options.modes)}
    return find_ways(profiles, options.modes, options.peers, chosen, run.runtime)


def curve_rows(run: Run) -> Iterator[Row]:
    """Profiles, modes and formats, each over its Q_g, on windows of 2, 4 and 6 views."""
    yield from _point_rows(run, "curves", _ways(run, CURVE_QPS))


def idea_rows(run: Run) -> Iterator[Row]:
    """The default profile without each of its ideas."""
    qps = run.options.qps or (QUICK_QPS if run.quick else IDEA_QPS)
    yield from _point_rows(run, "ideas", ideas.idea_ways(qps, run.runtime))


# ---- shown --------------------------------------------------------------------------------------------------------


def plot_curves(path: Path, rows: Sequence[Row]) -> bool:
    """Decoded against raw, and against photos where there are any, by network; a column per number of views."""
    grid = []
    for (network,), of_network in grouped(measured(rows, "curves"), "network").items():
        for key, label in ((TO_RAW, "dB, decoded to raw"), (TO_PHOTO, "dB, decoded to photo")):
            chart, panels = Chart("curves", "", _KB, Axis(key, label)), []
            for (views,), members in grouped(of_network, "views").items():
                level = Axis("psnr_raw", "").of(members) if key == TO_PHOTO else None
                panels += [replace(p, title=f"{network}, {views} views") for p in chart.panels(members, level)]
            grid += [panels] if panels else []
    if grid:
        save_grid(path, "Means over windows; dashed: the raw Gaussians", grid)
    return bool(grid)


_KB = Axis("bytes", "KB", unit=1e-3)

CURVES = Study(
    "Rate–distortion", curve_rows, {"curves": overview_table, "curves by views": group_tables}, {"curves": plot_curves}
)
IDEAS = Study("What each idea gains", idea_rows, {"ideas": gain_table})
