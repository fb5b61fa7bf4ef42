"""What does quality cost in bytes? Rate–distortion of our profiles, and what each idea of the codec gains.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians, at cameras that the Gaussians were not made
from where there are some: against pictures of the raw ones, and against photos where these are at hand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians

from ..ideas import CHANGES, idea_coders
from ..pictures import Drawing, PictureJudge
from ..rows import Row, grouped
from ..runner import WindowJob, run_jobs
from ..show.curve_tables import TO_PHOTO, TO_RAW, gain_table, measured, overview_table
from ..show.plots import Axis, Chart, save_grid
from ..study import Run, Study
from ..subjects.cases import FILE

CURVE_QPS: Mapping[str, tuple[float, ...]] = {
    "paper": (-6, 0, 6, 12, 18),
    **dict.fromkeys(("fast", "balanced", "max"), (-4, 2, 8)),
}
"""Q_g by profile: each steps around 40 dB."""

QUICK_QPS = (0.0, 8.0)

IDEA_QPS = (-4.0, 0.0, 4.0)
"""Of the profile with all its ideas, and of other settings of it; without an idea, the middle."""

VIEWS, KINDS = (2, 4, 6), ("near", "multi")

# ---- measuring ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class WindowRows:
    """The work on every window: a row per way and Q_g.

    Attributes:
        study: the rows'.
        qps: by way.
        targets: pictures at most.
        coders: what codes Gaussians at a Q_g, by way.
    """

    study: str
    qps: Mapping[str, Sequence[float]]
    targets: int
    coders: Mapping[str, Callable[[Gaussians, float], bytes]]

    def wanted(self, job: WindowJob) -> list[Row]:
        """See `runner.Work`."""
        stamp = job.stamp(self.targets)
        return [replace(_row(self.study, job, name, qp), stamp=stamp) for name, qps in self.qps.items() for qp in qps]

    def measure(self, job: WindowJob, wanted: Sequence[Row], runtime: Runtime) -> Iterator[Row]:
        """See `runner.Work`."""
        pictures = PictureJudge(job.case(runtime).only(self.targets), Drawing.as_defined(runtime.threads))
        for row in wanted:
            data = self.coders[row.way](pictures.case.gaussians, row.setting["qp"])
            yield replace(row, figures={"bytes": len(data), **pictures.figures(runtime.decompress(data))})


def _row(study: str, job: WindowJob, way: str, qp: float) -> Row:
    network = job.model if job.source.needs_network else FILE
    setting = {"network": network, "views": len(job.window.context), "qp": qp, "size": job.size}
    return Row(study, f"{job.source.name} {job.window}", way, setting)


def curve_rows(run: Run) -> Iterator[Row]:
    """Profiles, each over its Q_g."""
    profiles = run.options.profiles or (("balanced", "paper") if run.quick else tuple(PROFILES))
    qps = run.options.qps or (QUICK_QPS if run.quick else ())

    def coder(name: str) -> Callable[[Gaussians, float], bytes]:
        return lambda gaussians, qp: run.runtime.compress(gaussians, name, qp, drop_invalid=True)

    wanted = {name: qps or CURVE_QPS[name] for name in profiles}
    yield from _rows(run, "curves", wanted, {name: coder(name) for name in profiles})


def idea_rows(run: Run) -> Iterator[Row]:
    """The default profile, and without each of its ideas."""
    coders, qps = idea_coders(run.runtime), run.options.qps or (QUICK_QPS if run.quick else IDEA_QPS)
    middle = sorted(qps)[len(qps) // 2 :][:1]
    yield from _rows(run, "ideas", {name: middle if name in CHANGES else qps for name in coders}, coders)


def _rows(
    run: Run, study: str, qps: Mapping[str, Sequence[float]], coders: Mapping[str, Callable[[Gaussians, float], bytes]]
) -> Iterator[Row]:
    """Of windows of 2, 4 and 6 views, of each number their share."""
    if not run.sources:
        raise InputError("needs scene folders or Gaussian files as INPUT", where="bench")
    work = WindowRows(study, qps, 1 if run.quick else run.options.targets, coders)
    for views in run.options.views or ((2,) if run.quick else VIEWS):
        plan = replace(run.plan(kinds=KINDS), views=(views,))
        outcome = run_jobs(plan, work, run.store, runtime=run.runtime)
        run.left_out += [str(entry) for entry in outcome.left_out]
        yield from outcome.rows


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

CURVES = Study("Rate–distortion", curve_rows, {"curves": overview_table}, {"curves": plot_curves})
IDEAS = Study("What each idea gains", idea_rows, {"ideas": gain_table})
