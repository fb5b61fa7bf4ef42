"""Rate–distortion of profiles, modes and other formats; what each idea of the codec gains; seconds of every profile.

    python benchmarks/rate_distortion.py curves   INPUT … [--model edge,sweep] [--modes photos,hybrid] [--peers spz,sog]
    python benchmarks/rate_distortion.py ablation INPUT … [--rounds 7]
    python benchmarks/rate_distortion.py seconds  INPUT … [--rounds 7]
                                                  [--views 2,4,6] [--limit 1] [--qps 0,6] [--quick] [-o FOLDER]

INPUT are scene folders with `eval_index.json`, folders of such, or Gaussian files. Pictures are taken at a window's
targets; of a Gaussian file, at the cameras in its `target_K` and `target_c2w`, or else midway between its views.

`curves` writes points.csv, curves.md and a plot per network; `ablation` points.csv and ablation.md of the profile
`balanced` without each of its ideas, with `--rounds` also what each costs; `seconds` medians of interleaved rounds
beside dB, and points.csv. `curves` and `ablation` go on where they were stopped, `seconds` adds to those at hand;
without INPUT, tables are made of all that a folder holds. docs/CODEC.md, docs/BENCHMARKS.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from tinysplat.bench.timing import Effort
from tinysplat.bench.way_seconds import (
    cost_table,
    read_times,
    save_seconds_plots,
    seconds_table,
    time_costs,
    time_ways,
    write_times,
)
from tinysplat.commands.eval import numbers, words
from tinysplat.evaluation import find_sources
from tinysplat.evaluation.curve_plots import save_rate_plots
from tinysplat.evaluation.curve_rows import Row, RowFile, grouped, read_rows
from tinysplat.evaluation.curve_tables import (
    bits_table,
    gain_table,
    overview_table,
    photo_table,
    rate_table,
    single_table,
)
from tinysplat.evaluation.rate_distortion import Pictures
from tinysplat.evaluation.runner import Job
from tinysplat.evaluation.subjects import Subject, list_subjects, load_subject, network_of, stamp
from tinysplat.evaluation.ways import MODES, PEERS, Way, ablation_ways, find_ways
from tinysplat_runtime.api import DEFAULT_MODEL, Runtime
from tinysplat_runtime.cli.parser import size
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.system.files import write_atomically

CURVE_QPS: Mapping[str, tuple[float, ...]] = {
    "paper": (-6, 0, 6, 12, 18),
    **dict.fromkeys(("fast", "balanced", "max"), (-4, 2, 8)),
    "photos": (-10, 2, 14),
    "hybrid": (-4, 6),
}
"""Q_g by what it belongs to: each steps around 40 dB, or down to sizes where photos still serve."""

ABLATION_QPS = (-4.0, 0.0, 4.0)
"""Of the profile with all its ideas; without one, the middle."""

SECONDS_QPS: Mapping[str, tuple[float, ...]] = {"paper": (8, 16)}
OTHER_SECONDS_QPS = (0.0, 6.0)
QUICK_QPS = (0.0, 8.0)


def build_parser() -> argparse.ArgumentParser:
    """The script's options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("what", choices=("curves", "ablation", "seconds"))
    parser.add_argument(
        "inputs",
        nargs="*",
        metavar="INPUT",
        help="scene folders, folders of such, Gaussian files; without any, tables of all that is in FOLDER",
    )
    parser.add_argument("--model", type=words, default=(DEFAULT_MODEL,), metavar="M,M", help="networks of the scenes")
    parser.add_argument("--profiles", type=words, default=tuple(PROFILES), metavar="P,P", help="default: all")
    parser.add_argument("--modes", type=words, default=(), metavar="M,M", help=f"of {', '.join(MODES)}; default none")
    parser.add_argument("--peers", type=words, default=(), metavar="F,F", help=f"of {', '.join(PEERS)}; default none")
    parser.add_argument("--qps", type=numbers, default=None, metavar="Q,Q", help="of everything; default by profile")
    parser.add_argument("--reference-qps", type=numbers, default=None, metavar="Q,Q", help="of the first profile")
    parser.add_argument("--views", type=numbers, default=(2.0, 4.0, 6.0), metavar="N,N", help="default 2,4,6")
    parser.add_argument("--kind", type=words, default=("near", "multi"), metavar="K,K", help="default near,multi")
    parser.add_argument("--limit", type=int, default=1, metavar="N", help="windows per scene and views; default 1")
    parser.add_argument("--targets", type=int, default=3, metavar="N", help="pictures per window at most; default 3")
    parser.add_argument("--size", type=size, default=(256, 256), metavar="HxW", help="of scenes; default 256x256")
    parser.add_argument(
        "--rounds", type=int, default=0, metavar="N", help="of timing; default 7 for seconds, else none"
    )
    parser.add_argument("--quick", action="store_true", help="two points a curve, one picture, three rounds")
    parser.add_argument("--threads", type=int, default=None, metavar="N", help="default: all cores")
    parser.add_argument("-o", "--output", type=Path, default=Path("rate_distortion"), metavar="FOLDER")
    return parser


def jobs_of(options: argparse.Namespace) -> list[Job]:
    """Windows that the options name; what is left out is said on standard error."""
    sources, left_out = find_sources(options.inputs)
    views = [int(count) for count in options.views]
    jobs, lost = list_subjects(sources, options.model, options.kind, views, options.limit, options.size)
    for entry in (*left_out, *lost):
        print(f"rate_distortion: {entry}", file=sys.stderr)
    if not jobs:
        raise InputError("no window to measure", where="rate_distortion")
    return jobs


def ways_of(options: argparse.Namespace, runtime: Runtime) -> list[Way]:
    """What is compared, the reference first."""
    qps = options.qps or (QUICK_QPS if options.quick else None)
    if options.what == "ablation":
        return ablation_ways(qps or ABLATION_QPS, runtime)
    names = (*options.profiles, *options.modes)
    if options.what == "seconds":
        default = {name: SECONDS_QPS.get(name, OTHER_SECONDS_QPS) for name in names}
    else:
        default = {name: CURVE_QPS.get(name, ()) for name in names}
    chosen = {name: qps or default[name] for name in names}
    if options.reference_qps:
        chosen[names[0]] = options.reference_qps
    return find_ways(options.profiles, options.modes, options.peers, chosen, runtime)


def measured(jobs: Sequence[Job], ways: Sequence[Way], options: argparse.Namespace, runtime: Runtime) -> Iterator[Row]:
    """A row per window, way and setting; those at hand are not measured again."""
    kept = RowFile(options.output / "points.csv")
    for job in jobs:
        network, views, case, mark = *_identity(job), stamp(job)
        loaded: tuple[Subject, Pictures] | None = None
        for way in ways:
            for setting in way.settings:
                row = kept.find((network, views, case, way.name, setting), mark)
                if row is None:
                    loaded = loaded or _load(job, options, runtime)
                    subject, pictures = loaded
                    refused = way.refuses(subject)
                    if refused:
                        print(f"rate_distortion: {job}: no {way.name}, {refused}", file=sys.stderr)
                        break
                    point = way.measure(subject, pictures, setting)
                    row = Row(network, views, case, way.name, point, pictures.raw_to_photo, mark)
                    row = kept.add(row)
                    text = f"{way.name} {setting:g}: {point.bytes} B, {point.psnr:.2f} dB"
                    print(f"{job}: {text}", file=sys.stderr, flush=True)
                yield row


def effort_of(options: argparse.Namespace) -> Effort:
    """Rounds of timing."""
    return Effort(options.rounds or (3 if options.quick else 7), budget_s=float("inf"))


def write_seconds(jobs: Sequence[Job], ways: Sequence[Way], options: argparse.Namespace, runtime: Runtime) -> str:
    """Time every way and setting on every window, beside those that were timed before; returns the text."""
    path, kept, times = options.output / "seconds.json", RowFile(options.output / "points.csv"), []
    for job in jobs:
        subject, pictures = _load(job, options, runtime)
        able = [way for way in ways if not way.refuses(subject)]
        identity, mark = _identity(job), stamp(job)
        for entry, point in time_ways(able, subject, pictures, effort_of(options), identity):
            times.append(entry)
            kept.add(Row(*identity, entry.way, point, pictures.raw_to_photo, mark))
    times = list({entry.key: entry for entry in (*read_times(path), *times)}.values())
    write_times(path, times)
    save_seconds_plots(options.output, times)
    return seconds_table(times) + "\n"


def costs_text(jobs: Sequence[Job], options: argparse.Namespace, runtime: Runtime) -> str:
    """What each idea costs on every window."""
    return cost_table([
        cost
        for job in jobs
        for cost in time_costs(load_subject(job, runtime), 0.0, runtime, effort_of(options), _identity(job))
    ])  # fmt: skip


def write_curves(rows: Sequence[Row], folder: Path) -> str:
    """Tables and plots of `curves`; returns the text."""
    sections = []
    for (network, views), members in grouped(rows, "network", "views").items():
        cases = ", ".join(dict.fromkeys(row.case for row in members))
        tables = (rate_table(members), single_table(members), photo_table(members), bits_table(members))
        sections.append("\n\n".join([f"## {network}, {views} views: {cases}", *(table for table in tables if table)]))
    save_rate_plots(folder, rows)
    return "\n\n".join(filter(None, [overview_table(rows), *sections])) + "\n"


def run(options: argparse.Namespace) -> str:
    """Measure; returns the text."""
    if options.quick:
        options.targets = 1
    runtime = Runtime(threads=options.threads)
    jobs, ways = jobs_of(options) if options.inputs else [], ways_of(options, runtime)
    options.output.mkdir(parents=True, exist_ok=True)
    if options.what == "seconds":
        return write_seconds(jobs, ways, options, runtime)
    points = options.output / "points.csv"
    rows = list(measured(jobs, ways, options, runtime)) if options.inputs else read_rows(points)
    rows.sort(key=lambda row: (row.network, row.views))
    if options.what == "curves":
        return write_curves(rows, options.output)
    costs = [costs_text(jobs, options, runtime)] if options.rounds else []
    return "\n\n".join([gain_table(rows), *costs]) + "\n"


def main() -> int:
    """Measure, print, write."""
    options = build_parser().parse_args()
    try:
        text = run(options)
        write_atomically(options.output / f"{options.what}.md", text.encode())
    except (TinySplatError, OSError) as error:
        print(f"rate_distortion: {error}", file=sys.stderr)
        return 2
    print(text, end="")
    return 0


def _identity(job: Job) -> tuple[str, int, str]:
    return network_of(job), len(job.window.context), f"{job.source.name} {job.window}"


def _load(job: Job, options: argparse.Namespace, runtime: Runtime) -> tuple[Subject, Pictures]:
    subject = load_subject(job, runtime)
    case, count = subject.case, options.targets
    photos = None if case.photos is None else case.photos[:count]
    return subject, Pictures(case.gaussians, case.cameras[:count], photos, runtime.threads)


if __name__ == "__main__":
    sys.exit(main())
