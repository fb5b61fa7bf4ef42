"""What does quality cost in bytes? Rate–distortion of our profiles.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians, at cameras that the Gaussians were not made
from where there are some: against pictures of the raw ones, and against photos where these are at hand.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render import DEFINITION

from ..curves import Point, bd_rate, bytes_at
from ..pictures import PictureJudge
from ..rows import Row, grouped, of_study
from ..runner import WindowJob, run_jobs
from ..show.plots import Axis, Chart, save_grid
from ..show.tables import ABSENT, format_table
from ..study import Run, Study
from ..subjects.cases import FILE

STUDY = "curves"

CURVE_QPS: Mapping[str, tuple[float, ...]] = {
    "paper": (-6, 0, 6, 12, 18),
    **dict.fromkeys(("fast", "balanced", "max"), (-4, 2, 8)),
}
"""Q_g by profile: each steps around 40 dB."""

QUICK_QPS = (0.0, 8.0)

VIEWS, KINDS = (2, 4, 6), ("near", "multi")

LIMITS_DB, EQUAL_DB = (38.0, 41.0), (39.0, 41.0)
"""Between which BD-rate is taken, and where bytes are compared."""

TO_RAW, TO_PHOTO = "psnr_decoded_raw", "psnr"

# ---- measuring ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WindowRows:
    """The work on every window: a row per profile and Q_g.

    Attributes:
        qps: by profile.
        targets: pictures at most.
    """

    qps: Mapping[str, Sequence[float]]
    targets: int

    def wanted(self, job: WindowJob) -> list[Row]:
        """See `runner.Work`."""
        network, stamp = job.model if job.source.needs_network else FILE, job.stamp(self.targets)
        setting = {"network": network, "views": len(job.window.context)}
        return [
            Row(STUDY, f"{job.source.name} {job.window}", profile, {**setting, "qp": qp, "size": job.size}, stamp=stamp)
            for profile, qps in self.qps.items()
            for qp in qps
        ]

    def measure(self, job: WindowJob, wanted: Sequence[Row], runtime: Runtime) -> Iterator[Row]:
        """See `runner.Work`."""
        pictures = PictureJudge(job.case(runtime).only(self.targets), runtime.threads, **DEFINITION)
        for row in wanted:
            data = runtime.compress(pictures.case.gaussians, row.way, row.setting["qp"], drop_invalid=True)
            yield replace(row, figures={"bytes": len(data), **pictures.figures(runtime.decompress(data))})


def curve_rows(run: Run) -> Iterator[Row]:
    """Profiles, each over its Q_g, in windows of 2, 4 and 6 views, of each number their share."""
    if not run.sources:
        raise InputError("needs scene folders or Gaussian files as INPUT", where="bench")
    profiles = run.options.profiles or (("balanced", "paper") if run.quick else tuple(PROFILES))
    qps = run.options.qps or (QUICK_QPS if run.quick else ())
    work = WindowRows({name: qps or CURVE_QPS[name] for name in profiles}, 1 if run.quick else run.options.targets)
    for views in run.options.views or ((2,) if run.quick else VIEWS):
        yield from run.done(run_jobs(replace(run.plan(KINDS), views=(views,)), work, run.store, runtime=run.runtime))


# ---- shown --------------------------------------------------------------------------------------------------------
# The first profile of a group of rows is the reference. Figures are taken window by window and then averaged, shares of
# bytes geometrically, because windows differ in the dB that they reach. Where curves do not meet, the table says so.

Windows = Sequence[Mapping[str, Sequence[Point]]]
"""Of each window a curve by profile."""


def _windows(rows: Sequence[Row]) -> Windows:
    return [
        {
            way: [(row.figures["bytes"], row.figures[TO_RAW]) for row in points]
            for (way,), points in grouped(members, "way").items()
        }
        for members in grouped(rows, "subject").values()
    ]


def overview_table(rows: Sequence[Row]) -> str:
    """BD-rate and bytes of the profiles that have curves, by network and number of views; empty where only one has."""
    rows = of_study(rows, STUDY)
    ways = [way for (way,), members in grouped(rows, "way").items() if len(members) > len(_windows(members))]
    if len(ways) < 2:
        return ""
    table = []
    for (network, views), members in grouped(rows, "network", "views").items():
        windows, name = _windows(members), f"{network}, {views} views"
        rates = [_rate_cell(windows, ways[0], way) for way in ways[1:]]
        table.append([name, f"BD-rate {LIMITS_DB[0]:g}–{LIMITS_DB[1]:g} dB", ABSENT, *rates])
        for db in EQUAL_DB:
            table.append([name, f"KB at {db:g} dB", *(_size_cell(windows, ways[0], way, db) for way in ways)])
    return format_table(["", "", *ways], table)


def _size_cell(windows: Windows, reference: str, way: str, db: float) -> str:
    """Mean KB at a window's dB, and the share of the reference's bytes over the windows where both reach it."""
    pairs = [[bytes_at(curves.get(name, ()), db) for name in (way, reference)] for curves in windows]
    sizes = [size for size, _ in pairs if size is not None]
    shares = [size / other for size, other in pairs if size is not None and other is not None]
    if not sizes:
        return ABSENT
    share = f" ({statistics.geometric_mean(shares):.0%})" if shares else ""
    return f"{statistics.fmean(sizes) / 1000:.1f}{share}{_counted(len(sizes), len(windows))}"


def _rate_cell(windows: Windows, reference: str, way: str) -> str:
    """Mean BD-rate with its range over windows; why there is none."""
    rates, refused = [], ""
    for curves in windows:
        try:
            rates.append(bd_rate(curves.get(reference, ()), curves.get(way, ()), LIMITS_DB))
        except InputError as error:
            refused = error.message.partition(",")[0]
    if not rates:
        return refused or ABSENT
    mean = math.expm1(statistics.fmean(map(math.log1p, rates)))
    over = f" ({min(rates):+.0%} to {max(rates):+.0%})" if len(rates) > 1 else ""
    return f"{mean:+.1%}{over}{_counted(len(rates), len(windows))}"


def _counted(count: int, total: int) -> str:
    return "" if count == total else f", {count} of {total}"


def plot_curves(path: Path, rows: Sequence[Row]) -> bool:
    """Decoded against raw, and against photos where there are any, by network; a column per number of views."""
    grid = []
    for (network,), of_network in grouped(of_study(rows, STUDY), "network").items():
        for key, label in ((TO_RAW, "dB, decoded to raw"), (TO_PHOTO, "dB, decoded to photo")):
            chart, panels = Chart(STUDY, "", Axis("bytes", "KB", unit=1e-3), Axis(key, label)), []
            for (views,), members in grouped(of_network, "views").items():
                level = Axis("psnr_raw", "").of(members) if key == TO_PHOTO else None
                panels += [replace(p, title=f"{network}, {views} views") for p in chart.panels(members, level)]
            grid += [panels] if panels else []
    if grid:
        save_grid(path, "Means over windows; dashed: the raw Gaussians", grid)
    return bool(grid)


CURVES = Study("Rate–distortion", curve_rows, {STUDY: overview_table}, {STUDY: plot_curves})
