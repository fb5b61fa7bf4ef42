"""What does quality cost in bytes? Rate–distortion of ways to store the same Gaussians, what each idea of the codec
gains and costs, and seconds beside dB.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians, at cameras that the Gaussians were not made
from where there are some: against pictures of the raw ones, and against photos where these are at hand.
"""

from __future__ import annotations

import gc
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.planes import LayerPlan

from .. import ideas
from ..clock import Effort, Variant, measure, timed
from ..pictures import Drawing, Pictures
from ..rows import Row, grouped
from ..runner import Job, Plan, list_jobs, run_jobs
from ..show.curve_tables import TO_PHOTO, TO_RAW, cost_table, gain_table, group_tables, measured, overview_table
from ..show.plots import Curve, Panel, save_grid
from ..show.tables import format_table, number
from ..study import Run, Study
from ..subjects.cases import FILE
from ..ways import Way, find_ways

CURVE_QPS: Mapping[str, tuple[float, ...]] = {
    "paper": (-6, 0, 6, 12, 18),
    **dict.fromkeys(("fast", "balanced", "max"), (-4, 2, 8)),
    "photos": (-10, 2, 14),
    "hybrid": (-4, 6),
}
"""Q_g by what it belongs to: each steps around 40 dB, or down to sizes where photos still serve."""

SECONDS_QPS: Mapping[str, tuple[float, ...]] = {"paper": (8, 16)}
OTHER_SECONDS_QPS, QUICK_QPS = (0.0, 6.0), (0.0, 8.0)

IDEA_QPS = (-4.0, 0.0, 4.0)
"""Of the profile with all its ideas; without one, the middle."""

VIEWS, KINDS = (2, 4, 6), ("near", "multi")
# ---- measuring ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Points:
    """The work on every window: a row per way and setting."""

    study: str
    ways: Sequence[Way]
    targets: int

    def wanted(self, job: Job) -> list[Row]:
        """See `runner.Work`."""
        stamp = job.stamp(self.targets)
        return [replace(_row(self.study, job, way.name, qp), stamp=stamp) for way in self.ways for qp in way.settings]

    def measure(self, job: Job, wanted: Sequence[Row], runtime: Runtime) -> Iterator[Row]:
        """See `runner.Work`."""
        case = job.case(runtime).only(self.targets)
        pictures, ways = Pictures(case, Drawing.as_defined(runtime.threads)), {way.name: way for way in self.ways}
        for row in wanted:
            way = ways[row.way]
            refused = way.refuses(case)
            if refused:
                yield replace(row, note=refused)
                continue
            data = way.encode(case, row.setting["qp"])
            yield replace(row, figures=point_figures(way, data, pictures))


def point_figures(way: Way, data: bytes, pictures: Pictures) -> dict[str, Any]:
    """Bytes, dB and bytes by class of one file."""
    decoded = way.decode(pictures.case, data)
    return {"bytes": len(data), **pictures.figures(decoded), "classes": dict(way.classes(data))}


def _row(study: str, job: Job, way: str, qp: float) -> Row:
    network = job.model if job.source.needs_network else FILE
    subject = f"{job.source.name} {job.window}"
    return Row(study, subject, way, {"network": network, "views": len(job.window.context), "qp": qp, "size": job.size})


def _plans(run: Run) -> Iterator[Plan]:
    """A plan per number of views, so that each number has its share of windows."""
    if not run.sources:
        raise InputError("needs scene folders or Gaussian files as INPUT", where="bench")
    for views in run.options.views or ((2,) if run.quick else VIEWS):
        yield run.plan((views,), KINDS)


def _point_rows(run: Run, study: str, ways: Sequence[Way]) -> Iterator[Row]:
    work = Points(study, ways, 1 if run.quick else run.options.targets)
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
    """The default profile without each of its ideas; with rounds, what each idea costs too."""
    qps = run.options.qps or (QUICK_QPS if run.quick else IDEA_QPS)
    yield from _point_rows(run, "ideas", ideas.idea_ways(qps, run.runtime))
    if run.options.rounds:
        for job in (job for plan in _plans(run) for job in list_jobs(plan)[0]):
            yield from _cost_rows(job, run.runtime, run.options.rounds)


def _cost_rows(job: Job, runtime: Runtime, rounds: int) -> Iterator[Row]:
    """What an idea costs on one window, in CPU seconds over the codec without it; negative where it saves.

    Planning is that of the ideas that a setting undoes, which plan otherwise; coding and decoding that of the planes.
    """
    gaussians = job.case(runtime).gaussians

    def encoder(profile: Any = ideas.BASE) -> SceneEncoder:
        return SceneEncoder(gaussians, profile, runtime.store, threads=runtime.threads, drop_invalid=True)

    def coded(plans: Sequence[LayerPlan]) -> tuple[float, float]:
        coder, data = encoder(), list[bytes]()
        _, coding = timed(lambda: data.append(coder.code(plans, 0.0)))
        return coding, timed(lambda: runtime.decompress(data[0]))[1]

    plain = encoder().plan(0.0)
    changed = {name: ideas.changed_plans(gaussians, 0.0, runtime, change) for name, change in ideas.CHANGES.items()}
    found: dict[str, list[tuple[float, ...]]] = {}
    gc.freeze()  # as `clock.measure` does
    for _ in range(rounds + 1):
        coding, planning = coded(plain), timed(lambda: encoder().plan(0.0))[1]
        for name, plans in changed.items():
            without = coded(plans)
            found.setdefault(name, []).append((0.0, coding[0] - without[0], coding[1] - without[1]))
        for name, profile in ideas.other_settings().items():
            without_it = timed(lambda profile=profile: encoder(profile).plan(0.0))[1]  # type: ignore[misc]
            found.setdefault(name, []).append((planning - without_it, 0.0, 0.0))
    gc.unfreeze()
    for name, costs in found.items():
        plan, code, decode = (statistics.median(column) for column in zip(*costs[1:], strict=True))
        yield replace(_row("idea costs", job, name, 0.0), costs={"plan": plan, "coding": code, "decoding": decode})


def seconds_rows(run: Run) -> Iterator[Row]:
    """Every way and setting on every window, in turns; `setting` says whether a row is of encoding or decoding."""
    ways = _ways(run, SECONDS_QPS, OTHER_SECONDS_QPS)
    effort = Effort(run.options.rounds or (3 if run.quick else 7))
    for job in (job for plan in _plans(run) for job in list_jobs(plan)[0]):
        case = job.case(run.runtime).only(1 if run.quick else run.options.targets)
        pictures = Pictures(case, run.drawing)
        able = [(way, qp) for way in ways if not way.refuses(case) for qp in way.settings]
        variants = []
        for way, qp in able:
            data = way.encode(case, qp)
            figures = point_figures(way, data, pictures)
            for stage, call in (("encode", partial(way.encode, case, qp)), ("decode", partial(way.decode, case, data))):
                setting = {**_row("", job, way.name, qp).setting, "stage": stage}
                variants.append(Variant(way.name, call, lambda _, f=figures: f, setting, run.threads))  # type: ignore[misc]
        yield from measure("seconds", f"{job.source.name} {job.window}", variants, effort)


# ---- plots and seconds --------------------------------------------------------------------------------------------


def plot_curves(path: Path, rows: Sequence[Row]) -> bool:
    """Decoded against raw, and against photos where there are any, by network; a column per number of views."""
    grid = []
    for (network,), of_network in grouped(measured(rows, "curves"), "network").items():
        for key, label in ((TO_RAW, "dB, decoded to raw"), (TO_PHOTO, "dB, decoded to photo")):
            panels = [_panel(network, views, members, key, label) for (views,), members in
                      grouped(of_network, "views").items()]  # fmt: skip
            grid += [panels] if any(panel.curves for panel in panels) else []
    if grid:
        save_grid(path, "Means over windows; dashed: the raw Gaussians", grid)
    return bool(grid)


def _panel(network: str, views: int, rows: Sequence[Row], key: str, label: str) -> Panel:
    curves = []
    for (way,), members in grouped(rows, "way").items():
        points = []
        for found in grouped(members, "qp").values():
            figures = [row.figures for row in found if row.figures.get(key) is not None]
            if figures:
                points.append((statistics.fmean(f["bytes"] for f in figures) / 1000,
                               statistics.fmean(f[key] for f in figures)))  # fmt: skip
        curves += [Curve(way, points)] if points else []
    raw = [row.figures["psnr_raw"] for row in rows if "psnr_raw" in row.figures]
    return Panel(
        f"{network}, {views} views", "KB", label, curves, statistics.fmean(raw) if raw and key == TO_PHOTO else None
    )


def seconds_table(rows: Sequence[Row]) -> str:
    """A line per way and setting, a table per window."""
    sections = []
    for (subject,), members in grouped((row for row in rows if row.study == "seconds"), "subject").items():
        lines = []
        for (way, qp), pair in grouped(members, "way", "qp").items():
            cells = [cell for row in pair for cell in (number(row.costs["seconds"], 3),
                     f"{row.costs['low']:.3f}–{row.costs['high']:.3f}", number(row.costs["cpu"], 3))]  # fmt: skip
            figures = pair[0].figures
            lines.append([f"{way}, Q_g {qp:g}", number(figures["bytes"] / 1000, 1), number(figures[TO_RAW], 2), *cells])
        header = ["", "KB", "dB", "encode s", "quartiles", "CPU s", "decode s", "quartiles", "CPU s"]
        sections.append(f"**{members[0].setting['network']}, {subject}**\n\n{format_table(header, lines)}")
    return "\n\n".join(sections)


def plot_seconds(path: Path, rows: Sequence[Row]) -> bool:
    """dB against seconds, encoding above and decoding below, a panel per network and number of views."""
    rows = [row for row in rows if row.study == "seconds"]
    grid = []
    for (stage,), of_stage in grouped(rows, "stage").items():
        panels = []
        for (network, views), members in grouped(of_stage, "network", "views").items():
            curves = []
            for (way,), found in grouped(members, "way").items():
                groups = grouped(found, "qp").values()
                points = [(statistics.fmean(r.costs["seconds"] for r in g),
                           statistics.fmean(r.figures[TO_RAW] for r in g)) for g in groups]  # fmt: skip
                curves.append(Curve(way, points))
            panels.append(Panel(f"{stage}: {network}, {views} views", "seconds, median", "dB, decoded to raw", curves))
        grid.append(panels)
    if grid:
        save_grid(path, "Error against run time, means over windows", grid)
    return bool(grid)


CURVES = Study(
    "Rate–distortion", curve_rows, {"curves": overview_table, "curves by views": group_tables}, {"curves": plot_curves}
)
IDEAS = Study("What each idea gains", idea_rows, {"ideas": gain_table, "idea costs": cost_table})
SECONDS = Study("Seconds beside dB", seconds_rows, {"seconds": seconds_table}, {"seconds": plot_seconds})
