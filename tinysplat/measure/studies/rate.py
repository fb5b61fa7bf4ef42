"""What does quality cost in bytes? Rate–distortion of ways to store the same Gaussians, what each idea of the codec
gains and costs, and other people's formats.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians, at cameras that the Gaussians were not made
from where there are some: against pictures of the raw ones, and against photos where these are at hand.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import InputError

from .. import ideas
from ..clock import Effort, Variant, measure, summarised, timed
from ..pictures import Drawing, Pictures
from ..rows import Row, grouped
from ..runner import Plan, WindowJob, list_jobs, run_jobs
from ..show.curve_tables import TO_PHOTO, TO_RAW, gain_table, group_tables, measured, overview_table
from ..show.plots import Axis, Chart, save_grid
from ..show.tables import BYTES, LOST, Column, View, decibels
from ..study import Run, Study
from ..subjects.cases import FILE, Case, truncated
from ..ways import MAX_DEGREE, MissingToolError, Way, find_ways, peer_ways, tool_note

CURVE_QPS: Mapping[str, tuple[float, ...]] = {
    "paper": (-6, 0, 6, 12, 18),
    **dict.fromkeys(("fast", "balanced", "max"), (-4, 2, 8)),
    "photos": (-10, 2, 14),
    "hybrid": (-4, 6),
}
"""Q_g by what it belongs to: each steps around 40 dB, or down to sizes where photos still serve."""

QUICK_QPS = (0.0, 8.0)
IDEA_QPS = (-4.0, 0.0, 4.0)
"""Of the profile with all its ideas; without one, the middle."""

VIEWS, KINDS = (2, 4, 6), ("near", "multi")

SOG_LIMIT_S, QUICK_SOG_LIMIT_S = 240.0, 5.0
"""SOG is given up after this long: on a CPU its clustering of SH takes minutes."""

EXACT_DB = 100
"""Above it a format is exact but for float32's rounding; its dB would flatten all others on a plot."""

# ---- measuring ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Points:
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


def _row(study: str, job: WindowJob, way: str, qp: float) -> Row:
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
    """The default profile without each of its ideas; with rounds, seconds of each on the first windows too."""
    qps = run.options.qps or (QUICK_QPS if run.quick else IDEA_QPS)
    yield from _point_rows(run, "ideas", ideas.idea_ways(qps, run.runtime))
    if run.options.rounds:
        yield from _timed(run, "ideas", ideas.idea_ways((0.0,), run.runtime), Effort(run.options.rounds))


def _timed(run: Run, study: str, ways: Sequence[Way], effort: Effort) -> Iterator[Row]:
    for job in (job for plan in _plans(run) for job in list_jobs(plan)[0]):
        case = replace(job.case(run.runtime).only(1 if run.quick else run.options.targets), name=str(job))
        group = f"{_row('', job, '', 0.0).setting['network']}, {len(job.window.context)} views"
        yield from compare_ways(study, case, ways, run, effort, {"group": group})


def peer_rows(run: Run) -> Iterator[Row]:
    """Other formats, side by side in one run: bytes, seconds, dB."""
    ways = peer_ways(run.runtime, QUICK_SOG_LIMIT_S if run.quick else SOG_LIMIT_S)
    for case in run.cases:
        if case.gaussians.degree > MAX_DEGREE:
            cut = truncated(case.gaussians, MAX_DEGREE)
            case = replace(case, name=f"{case.name}, cut to {MAX_DEGREE}", gaussians=cut)
        yield from compare_ways("peers", case, ways, run, run.effort)


def compare_ways(
    study: str, case: Case, ways: Sequence[Way], run: Run, effort: Effort, setting: Mapping[str, Any] | None = None
) -> list[Row]:
    """Rows of `STUDY encode` (with bytes and dB) and `STUDY decode`, one of each per way and setting."""
    pictures, rows, variants = Pictures(case, run.drawing), [], []
    for way, qp in [(one, qp) for one in ways for qp in one.settings]:
        name = f"{way.name}, Q_g {qp:g}" if len(way.settings) > 1 else way.name
        encode, results = partial(way.encode, case, qp), list[Any]()
        chosen: dict[str, Any] = {**(setting or {}), "tool": way.tool, "coding": way.name, "qp": qp}
        refused = way.refuses(case)
        try:
            if refused:
                raise MissingToolError(refused)
            times = [timed(lambda: results.append(encode()))]  # noqa: B023 - called at once
            decode = partial(way.decode, case, results[0])
            times.append(timed(lambda: results.append(decode())))  # noqa: B023
        except (MissingToolError, InputError) as error:
            rows.append(Row(f"{study} encode", case.name, name, chosen, note=str(error)))
            continue
        figures, note = {"bytes": len(results[0]), **pictures.figures(results[1])}, tool_note(way.tool)
        if way.is_slow:
            chosen |= {"threads": way.threads}
            for stage, found, time in (("encode", figures, times[0]), ("decode", {}, times[1])):
                rows.append(Row(f"{study} {stage}", case.name, name, chosen, found, summarised([time]), note))
        else:
            variants.append((Variant(name, encode, lambda _, f=figures: f, chosen, way.threads),  # type: ignore[misc]
                             Variant(name, decode, lambda _, f=figures: f, chosen, way.threads)))  # type: ignore[misc] # fmt: skip
    for i, stage in enumerate(("encode", "decode")):
        timed_rows = measure(f"{study} {stage}", case.name, [pair[i] for pair in variants], effort)
        rows += [replace(row, note=tool_note(row.setting["tool"])) for row in timed_rows]
    order = [way.name for way in ways]
    return sorted(rows, key=lambda row: (row.study != f"{study} encode", order.index(row.setting["coding"])))


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
_CODED = (BYTES, Column(TO_RAW, "dB to raw", decibels), LOST)


def _stages(study: str, text: str) -> list[View]:
    better = {"costs": ("bytes",), "gains": (TO_RAW,)}
    return [
        View(f"{study} encode", "Encoding", text, _CODED, **better),  # type: ignore[arg-type]
        View(f"{study} decode", "Decoding", "A file's bytes to Gaussians.", _CODED, **better),  # type: ignore[arg-type]
    ]


CURVES = Study(
    "Rate–distortion", curve_rows, {"curves": overview_table, "curves by views": group_tables}, {"curves": plot_curves}
)
IDEAS = Study(
    "What each idea gains",
    idea_rows,
    {"ideas": gain_table, **{view.study: view for view in _stages("ideas", "Without one idea each, in turns.")}},
)
PEERS = Study.of(
    "Peers",
    peer_rows,
    *_stages("peers", "The same Gaussians in other formats, in the same run; dB to raw: against pictures of them."),
    Chart("peers encode", "The same Gaussians in several formats", _KB, Axis(TO_RAW, "dB to raw", most=EXACT_DB),
          panel="subject", point="way"),
)  # fmt: skip
