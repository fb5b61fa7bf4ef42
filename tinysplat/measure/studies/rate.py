"""What does quality cost in bytes? Rate–distortion of ways to store the same Gaussians, what each idea of the codec
gains and costs, and seconds beside dB.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians, at cameras that the Gaussians were not made
from where there are some: against pictures of the raw ones, and against photos where these are at hand. The first way
of a group of rows is the reference. Figures are taken window by window and then averaged, shares of bytes
geometrically, because windows differ in the dB that they reach. Where curves do not meet, the table says so.
"""

from __future__ import annotations

import gc
import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.planes import LayerPlan

from .. import ideas
from ..clock import Effort, Variant, measure, timed
from ..curves import Point, bd_rate, bytes_at
from ..pictures import Drawing, Pictures
from ..published import BITS
from ..rows import Row, grouped
from ..runner import Job, Plan, list_jobs, run_jobs
from ..show.plots import Curve, Panel, save_grid
from ..show.tables import ABSENT, format_table, number
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
EQUAL_DB = (38.0, 39.0, 40.0, 41.0)
LOSSES_DB = (0.5, 0.2, 0.1)
"""dB lost against photos, of what the raw Gaussians reach."""

PHOTO_OVERLAP_DB = 0.2
"""Against photos curves are flat: what the network is worth hides what coding costs."""

_OVERVIEW_DB = (39.0, 41.0)
_SHARES = ("position", "scale", "rotation", "color", "opacity", "photos")
_TO_RAW, _TO_PHOTO = "psnr_decoded_raw", "psnr"

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


# ---- curves -------------------------------------------------------------------------------------------------------

Windows = Mapping[str, Mapping[str, Sequence[Point]]]
"""Curves by window and way; the first way of a window is the reference."""


def _of(rows: Sequence[Row], study: str) -> list[Row]:
    return [row for row in rows if row.study == study and row.figures]


def _windows(rows: Sequence[Row], key: str = _TO_RAW) -> Windows:
    return {
        case: {
            way: [(row.figures["bytes"], row.figures[key]) for row in found if row.figures.get(key) is not None]
            for (way,), found in grouped(members, "way").items()
        }
        for (case,), members in grouped(rows, "subject").items()
    }


def _reference(curves: Mapping[str, Sequence[Point]]) -> Sequence[Point]:
    return next(iter(curves.values()))


def overview_table(rows: Sequence[Row]) -> str:
    """BD-rate and bytes of the ways that have curves, by network and number of views; empty where only one has."""
    rows = _of(rows, "curves")
    limits = EQUAL_DB[0], EQUAL_DB[-1]
    ways = [way for (way,), members in grouped(rows, "way").items() if len(members) > len(_windows(members))]
    if len(ways) < 2:
        return ""
    table = []
    for (network, views), members in grouped(rows, "network", "views").items():
        windows, name = _windows(members), f"{network}, {views} views"
        rates = [_rate_cell(windows, way, limits) for way in ways[1:]]
        table.append([name, f"BD-rate {limits[0]:g}–{limits[1]:g} dB", ABSENT, *rates])
        for db in _OVERVIEW_DB:
            sizes = [_size_cell(windows, way, dict.fromkeys(windows, db)) for way in ways]
            table.append([name, f"KB at {db:g} dB", *sizes])
    return format_table(["", "", *ways], table)


def group_tables(rows: Sequence[Row]) -> str:
    """All tables of each network and number of views."""
    sections = []
    for (network, views), members in grouped(_of(rows, "curves"), "network", "views").items():
        cases = ", ".join(dict.fromkeys(row.subject for row in members))
        tables = (rate_table(members), single_table(members), photo_table(members), bits_table(members))
        sections.append("\n\n".join([f"### {network}, {views} views: {cases}", *filter(None, tables)]))
    return "\n\n".join(sections)


def rate_table(rows: Sequence[Row]) -> str:
    """Bytes at equal PSNR of decoded against raw, and BD-rate against the first way; rows of one network and count."""
    windows, table = _windows(rows), []
    for way in dict.fromkeys(row.way for row in rows):
        cells = [_size_cell(windows, way, dict.fromkeys(windows, db)) for db in EQUAL_DB]
        rates = [_rate_cell(windows, way, limits) for limits in ((EQUAL_DB[0], EQUAL_DB[-1]), None)]
        table.append([way, _span(windows, way), *cells, *rates])
    labels = [f"KB at {db:g} dB" for db in EQUAL_DB]
    return format_table(["", "dB", *labels, f"BD-rate {EQUAL_DB[0]:g}–{EQUAL_DB[-1]:g} dB", "BD-rate, all"], table)


def photo_table(rows: Sequence[Row]) -> str:
    """Bytes by what is lost against photos; empty where there are no photos."""
    rows = [row for row in rows if row.figures.get(_TO_PHOTO) is not None]
    if not rows:
        return ""
    raw = {case: members[0].figures["psnr_raw"] for (case,), members in grouped(rows, "subject").items()}
    windows, table = _windows(rows, _TO_PHOTO), []
    for way in dict.fromkeys(row.way for row in rows):
        cells = [_size_cell(windows, way, {case: db - loss for case, db in raw.items()}) for loss in LOSSES_DB]
        table.append([way, _span(windows, way), *cells, _rate_cell(windows, way, None, PHOTO_OVERLAP_DB)])
    header = ["", "dB to photo", *(f"KB at {loss:g} dB lost" for loss in LOSSES_DB), "BD-rate, all"]
    mean = number(statistics.fmean(raw.values()), 2)
    return f"The raw Gaussians reach {mean} dB to the photos.\n\n{format_table(header, table)}"


def bits_table(rows: Sequence[Row]) -> str:
    """Every point, means over windows, below the paper's: dB, and each class's percentage of the pictures' bytes."""
    table = [
        ["printed", f"{qp}", number(kilobytes, 1), ABSENT, ABSENT, *(number(shares.get(c), 1) for c in _SHARES)]
        for qp, (kilobytes, shares) in BITS.items()
    ]
    for (way, qp), members in grouped(rows, "way", "qp").items():
        points = [row.figures for row in members if row.figures["classes"]]
        if not points:
            continue
        sizes = {name: statistics.fmean(p["classes"][name] for p in points) for name in points[0]["classes"]}
        sizes["position"] = sizes["depth"] + sizes["offset"]
        total = sum(sizes[name] for name in _SHARES if name in sizes)
        seen = [p[_TO_PHOTO] for p in points if p.get(_TO_PHOTO) is not None]
        cells = [number(statistics.fmean(p["bytes"] for p in points) / 1000, 1),
                 number(statistics.fmean(p[_TO_RAW] for p in points), 2),
                 number(statistics.fmean(seen) if seen else None, 2)]  # fmt: skip
        shares = [number(100 * sizes[c] / total if c in sizes else None, 1) for c in _SHARES]
        table.append([way, f"{qp:g}", *cells, *shares])
    return format_table(["", "Q_g", "KB", "dB to raw", "dB to photo", *_SHARES], table)


def single_table(rows: Sequence[Row]) -> str:
    """Formats of one size: bytes against what the first way needs for the same dB; empty where there are none."""
    windows, table = _windows(rows), []
    for way in dict.fromkeys(row.way for row in rows):
        points = {case: curves[way][0] for case, curves in windows.items() if len(curves.get(way, ())) == 1}
        if points:
            size, db = (statistics.fmean(values) for values in zip(*points.values(), strict=True))
            table.append([way, number(size / 1000, 1), number(db, 2), _multiple(windows, points)])
    return format_table(["", "KB", "dB", f"times `{rows[0].way}` at the same dB"], table) if table else ""


def gain_table(rows: Sequence[Row]) -> str:
    """What every idea gains: bytes of the codec without it over those with it at the same dB, by network and views."""
    rows = _of(rows, "ideas")
    groups = grouped(rows, "network", "views")
    ways = list(dict.fromkeys(row.way for row in rows))[1:]
    table = [[way, *(_gain_cell(_windows(members), way) for members in groups.values())] for way in ways]
    header = ["undone", *(f"{network}, {views} views" for network, views in groups)]
    return format_table(header, table) if table else ""


def cost_table(rows: Sequence[Row]) -> str:
    """CPU milliseconds of encoding and decoding by idea, a column pair per window."""
    rows = [row for row in rows if row.study == "idea costs"]
    if not rows:
        return ""
    cases = grouped(rows, "network", "views", "subject")
    lines = []
    for (idea,), members in grouped(rows, "way").items():
        by_case = {(r.setting["network"], r.setting["views"], r.subject): r.costs for r in members}
        pairs = [(by_case[c]["plan"] + by_case[c]["coding"], by_case[c]["decoding"]) for c in cases]
        lines.append([idea, *(cell for a, b in pairs for cell in (f"{1e3 * a:+.0f}", f"{1e3 * b:+.1f}"))])
    labels = [f"{network}, {views} views: {what}" for network, views, _ in cases for what in ("encode", "decode")]
    return "CPU milliseconds of the idea\n\n" + format_table(["undone", *labels], lines)


def _gain_cell(windows: Windows, way: str) -> str:
    """Mean share of bytes above the reference's at the dB of a way's points; a point itself where there is none."""
    gains, beyond = [], []
    for curves in windows.values():
        for size, db in curves.get(way, ()):
            reference = bytes_at(_reference(curves), db)
            if reference is None:
                beyond.append(f"{size / 1000:.0f} KB at {db:.1f} dB")
            else:
                gains.append(size / reference - 1)
    if not gains:
        return beyond[0] if beyond else ABSENT
    return f"{statistics.fmean(gains):+.1%}{_range(gains)}"


def _multiple(windows: Windows, points: Mapping[str, Point]) -> str:
    factors, beyond = [], []
    for case, (size, db) in points.items():
        reference = _reference(windows[case])
        wanted = bytes_at(reference, db)
        if wanted is None:
            best = max(reference, key=lambda p: p[1])
            beyond.append(f"{size / best[0]:.2f} × its {best[1]:.1f} dB")
        else:
            factors.append(size / wanted)
    text = [f"{_geometric(factors):.2f} ×" + _counted(len(factors), len(points))] if factors else []
    return "; ".join([*text, *(f"beyond its curve: {entry}" for entry in beyond)])


def _span(windows: Windows, way: str) -> str:
    """Means over windows of the ends of the curves."""
    ends = [[f(db for _, db in curves[way]) for f in (min, max)] for curves in windows.values() if curves.get(way)]
    low, high = np.mean(ends, axis=0)
    return f"{low:.1f}" if low == high else f"{low:.1f}–{high:.1f}"


def _size_cell(windows: Windows, way: str, decibels: Mapping[str, float]) -> str:
    """Mean KB at each window's dB, and the share of the reference's bytes over the windows where both reach it."""
    sizes, shares = [], []
    for case, curves in windows.items():
        size, reference = (bytes_at(points, decibels[case]) for points in (curves.get(way, ()), _reference(curves)))
        if size is not None:
            sizes.append(size)
            shares += [] if reference is None else [size / reference]
    if not sizes:
        return ABSENT
    share = f" ({_geometric(shares):.0%})" if shares else ""
    return f"{statistics.fmean(sizes) / 1000:.1f}{share}{_counted(len(sizes), len(windows))}"


def _rate_cell(
    windows: Windows, way: str, limits: tuple[float, float] | None, least_overlap: float = 0.5
) -> str:  # fmt: skip
    """Mean BD-rate with its range over windows; why there is none."""
    rates, refused = [], ""
    for curves in windows.values():
        if way in curves:
            try:
                rates.append(bd_rate(_reference(curves), curves[way], limits, least_overlap))
            except InputError as error:
                refused = error.message.partition(",")[0]
    if not rates:
        return refused or ABSENT
    mean = math.expm1(statistics.fmean(map(math.log1p, rates)))
    return f"{mean:+.1%}{_range(rates)}{_counted(len(rates), len(windows))}"


def _range(shares: Sequence[float]) -> str:
    return f" ({min(shares):+.0%} to {max(shares):+.0%})" if len(shares) > 1 else ""


def _counted(count: int, total: int) -> str:
    return "" if count == total else f", {count} of {total}"


def _geometric(values: Sequence[float]) -> float:
    return math.exp(statistics.fmean(map(math.log, values)))


# ---- plots and seconds --------------------------------------------------------------------------------------------


def plot_curves(path: Path, rows: Sequence[Row]) -> bool:
    """Decoded against raw, and against photos where there are any, by network; a column per number of views."""
    grid = []
    for (network,), of_network in grouped(_of(rows, "curves"), "network").items():
        for key, label in ((_TO_RAW, "dB, decoded to raw"), (_TO_PHOTO, "dB, decoded to photo")):
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
        f"{network}, {views} views", "KB", label, curves, statistics.fmean(raw) if raw and key == _TO_PHOTO else None
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
            lines.append(
                [f"{way}, Q_g {qp:g}", number(figures["bytes"] / 1000, 1), number(figures[_TO_RAW], 2), *cells]
            )
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
                           statistics.fmean(r.figures[_TO_RAW] for r in g)) for g in groups]  # fmt: skip
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
