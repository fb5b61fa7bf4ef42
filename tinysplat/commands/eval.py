"""`tinysplat eval`: the figures of the paper's tables, on the user's own scenes."""

from __future__ import annotations

import json
import sys
import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from pathlib import Path

from tinysplat.datasets import SPECS
from tinysplat.measure.lpips import find_lpips
from tinysplat.measure.machine import run_row
from tinysplat.measure.quality import ProfileQp, Quality
from tinysplat.measure.rows import RESULTS, ROWS, RowFile
from tinysplat.measure.runner import RunOutcome, RunPlan, document, run_jobs
from tinysplat.measure.show.quality import results_text
from tinysplat.measure.subjects.cases import Source
from tinysplat.measure.subjects.sources import ChunkSource, find_sources
from tinysplat_runtime.cli.arguments import indices, size
from tinysplat_runtime.cli.options import add_threads
from tinysplat_runtime.cli.outputs import made_folder
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.system.files import write_atomically
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.threads import available_cores

HELP = "PSNR, SSIM, LPIPS, sizes and times on an evaluation index"

DEFAULT_FOLDER = "eval_results"

DEFAULT_SIZE = (256, 256)


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.usage = "tinysplat eval SCENES [SCENES …] [options]"
    parser.description = (
        "Measure networks and codings on scenes: raw, coded and photo baselines. Results are kept window by window; the"
        " same command goes on where a killed one stopped."
    )
    parser.add_argument(
        "scenes", nargs="+", metavar="SCENES", help="folders with eval_index.json or .torch chunks, or folders of such"
    )
    parser.add_argument(
        "-o",
        "--output",
        default=DEFAULT_FOLDER,
        metavar="FOLDER",
        help=f"where results are kept; default {DEFAULT_FOLDER}",
    )
    parser.add_argument(
        "--model", action="append", metavar="NAME|FILE.onnx", help=f"network, may be repeated; default {DEFAULT_MODEL}"
    )
    parser.add_argument(
        "--profile", type=words, default=(DEFAULT_PROFILE,), metavar="P,P", help=f"default {DEFAULT_PROFILE}"
    )
    parser.add_argument(
        "--qp", type=numbers, default=(0.0,), metavar="Q,Q", help="default 0; negative ones as --qp=-6,0"
    )
    parser.add_argument("--kind", type=words, default=(), metavar="K,K", help="kinds of window; default all")
    parser.add_argument(
        "--views", type=indices, default=(), metavar="N,N", help="numbers of context views; default all"
    )
    parser.add_argument("--limit", type=int, metavar="N", help="windows per scene; default all")
    parser.add_argument(
        "--size", type=size, metavar="WxH", help="of photos, cropped; default 256x256, or the data set's"
    )
    parser.add_argument("--near", type=float, metavar="Z", help="nearest depth, over the index's")
    parser.add_argument("--far", type=float, metavar="Z", help="farthest depth, over the index's")
    parser.add_argument("--index", metavar="F.json", help="evaluation index of a folder of chunks")
    parser.add_argument(
        "--dataset", choices=tuple(SPECS), default="re10k", metavar="NAME", help=f"of the chunks: {', '.join(SPECS)}"
    )
    parser.add_argument("--lpips", choices=("vgg", "none"), default="vgg", help="default vgg")
    parser.add_argument("--lpips-backbone", metavar="F.pth", help="torchvision's weights of the backbone")
    parser.add_argument("--lpips-linear", metavar="F.pth", help="linear weights; default: the package lpips's")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="windows measured at a time; default 1")
    parser.add_argument("--json", metavar="F.json", help="write all figures as JSON")
    add_threads(parser)


def words(text: str) -> tuple[str, ...]:
    """`paper,balanced` to a tuple."""
    parts = tuple(part.strip() for part in text.split(","))
    if not all(parts):
        raise ArgumentTypeError(f"'{text}', expected words such as paper,balanced")
    return parts


def numbers(text: str) -> tuple[float, ...]:
    """`0,6` to a tuple of numbers."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ArgumentTypeError(f"'{text}', expected numbers such as 0,6,12") from None


def run(args: Namespace) -> None:
    """Measure, print the tables, write what was asked for."""
    for name in ("jobs", "limit"):
        value = getattr(args, name)
        if value is not None and value < 1:
            raise InputError(f"{value}, expected 1 or more", where=f"--{name}")
    for profile in args.profile:
        find_profile(profile)
    lpips, lpips_text = None, "LPIPS not asked for"
    if args.lpips != "none":
        lpips, lpips_text = find_lpips(args.lpips_backbone, args.lpips_linear)
    sources, lost = find_sources(args.scenes, index=args.index, dataset=args.dataset, near=args.near, far=args.far)
    plan = RunPlan(
        sources,
        tuple(args.model or (DEFAULT_MODEL,)),
        args.size or _natural_size(sources),
        args.kind,
        args.views,
        args.limit,
    )
    folder = made_folder(args.output)
    codings = tuple(ProfileQp(p, q) for p in args.profile for q in args.qp)
    quality = Quality(codings, lpips)
    threads = args.threads or max(1, available_cores() // args.jobs)
    began, store = time.perf_counter(), RowFile(folder / ROWS)
    outcome = run_jobs(plan, quality, store, threads=threads, processes=args.jobs, quiet=args.quiet)
    store.add(run_row("eval", began))
    outcome.left_out[:0] = lost
    for line in (*map(str, outcome.left_out), *outcome.notes):
        print(f"tinysplat: {' '.join(line.split())}", file=sys.stderr)
    if not outcome.rows:
        raise InputError(f"nothing could be measured; {summary_line(outcome)}", where="eval")
    _write(folder, args.json, document(outcome, lpips_text, threads, args.jobs))
    if not args.quiet:
        print(results_text(outcome.rows))
        print(f"\n{summary_line(outcome)}; {lpips_text}; results in {folder}")


def summary_line(outcome: RunOutcome) -> str:
    """What was measured and what was not."""
    lost = sum(entry.count for entry in outcome.left_out)
    windows = len({(row.subject, str(row.setting["targets"])) for row in outcome.rows})
    text = (
        f"{windows} window{'s' * (windows != 1)} measured ({len(outcome.rows)} results, {outcome.resumed} from before)"
    )
    return f"{text}, {lost} left out" if lost else text


def _natural_size(sources: Sequence[Source]) -> tuple[int, int]:
    """The data set's size where there are chunks, else that of published figures."""
    chunks = [source for source in sources if isinstance(source, ChunkSource)]
    return SPECS[chunks[0].dataset].size if chunks else DEFAULT_SIZE


def _write(folder: Path, copy: str | None, document: JsonObject) -> None:
    data = (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()
    for path in [str(folder / RESULTS), *filter(None, [copy])]:
        write_atomically(path, data)
