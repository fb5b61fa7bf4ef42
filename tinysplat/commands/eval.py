"""`tinysplat eval`: the figures of the paper's tables, on the user's own scenes."""

import json
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import dataclass
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
from tinysplat_runtime.cli.asks import Quiet
from tinysplat_runtime.cli.files import Threads
from tinysplat_runtime.cli.options import add_options, asked
from tinysplat_runtime.cli.outputs import made_folder
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.files import write_atomically
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.options import REQUIRED, option
from tinysplat_runtime.system.threads import available_cores

HELP = "PSNR, SSIM, LPIPS, sizes and times on an evaluation index"

DEFAULT_FOLDER = "eval_results"

DEFAULT_SIZE = (256, 256)


@dataclass(frozen=True, kw_only=True)
class Eval(Threads, Quiet):
    """What the command asks for."""

    scenes: tuple[str, ...] = option(
        kinds.path,
        REQUIRED,
        is_bare=True,
        is_many=True,
        metavar="SCENES",
        help="folders with eval_index.json or .torch chunks, or folders of such",
    )
    output: str = option(
        kinds.path,
        DEFAULT_FOLDER,
        short="o",
        metavar="FOLDER",
        help=f"where results are kept; default {DEFAULT_FOLDER}",
    )
    model: tuple[str, ...] = option(
        kinds.text,
        (DEFAULT_MODEL,),
        is_many=True,
        metavar="NAME|FILE.onnx",
        help=f"network, may be repeated; default {DEFAULT_MODEL}",
    )
    profile: tuple[str, ...] = option(kinds.texts, (DEFAULT_PROFILE,), metavar="P,P", help=f"default {DEFAULT_PROFILE}")
    qp: tuple[float, ...] = option(kinds.numbers(), (0.0,), metavar="Q,Q", help="default 0; negative ones as --qp=-6,0")
    kind: tuple[str, ...] = option(kinds.texts, (), metavar="K,K", help="kinds of window; default all")
    views: tuple[int, ...] = option(kinds.indices, (), metavar="N,N", help="numbers of context views; default all")
    limit: int | None = option(kinds.count, metavar="N", help="windows per scene; default all")
    size: tuple[int, int] | None = option(
        kinds.size, metavar="WxH", help="of photos, cropped; default 256x256, or the data set's"
    )
    near: float | None = option(kinds.number, metavar="Z", help="nearest depth, over the index's")
    far: float | None = option(kinds.number, metavar="Z", help="farthest depth, over the index's")
    index: str | None = option(kinds.path, metavar="F.json", help="evaluation index of a folder of chunks")
    dataset: str = option(
        kinds.text, "re10k", metavar="NAME", choices=tuple(SPECS), help=f"of the chunks: {', '.join(SPECS)}"
    )
    lpips: str = option(kinds.text, "vgg", choices=("vgg", "none"), help="default vgg")
    lpips_backbone: str | None = option(kinds.path, metavar="F.pth", help="torchvision's weights of the backbone")
    lpips_linear: str | None = option(kinds.path, metavar="F.pth", help="linear weights; default: the package lpips's")
    jobs: int = option(kinds.count, 1, metavar="N", help="windows measured at a time; default 1")
    json: str | None = option(kinds.path, metavar="F.json", help="write all figures as JSON")


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.usage = "tinysplat eval SCENES [SCENES …] [options]"
    parser.description = (
        "Measure networks and codings on scenes: raw, coded and photo baselines. Results are kept window by window; the"
        " same command goes on where a killed one stopped."
    )
    add_options(parser, Eval)


def run(args: Namespace) -> None:
    """Measure, print the tables, write what was asked for."""
    own = asked(args, Eval)
    for profile in own.profile:
        find_profile(profile)
    lpips, lpips_text = None, "LPIPS not asked for"
    if own.lpips != "none":
        lpips, lpips_text = find_lpips(own.lpips_backbone, own.lpips_linear)
    sources, lost = find_sources(own.scenes, index=own.index, dataset=own.dataset, near=own.near, far=own.far)
    plan = RunPlan(sources, own.model, own.size or _natural_size(sources), own.kind, own.views, own.limit)
    folder = made_folder(own.output)
    codings = tuple(ProfileQp(p, q) for p in own.profile for q in own.qp)
    quality = Quality(codings, lpips)
    threads = own.threads or max(1, available_cores() // own.jobs)
    began, store = time.perf_counter(), RowFile(folder / ROWS)
    outcome = run_jobs(plan, quality, store, threads=threads, processes=own.jobs, quiet=own.quiet)
    store.add(run_row("eval", began))
    outcome.left_out[:0] = lost
    for line in (*map(str, outcome.left_out), *outcome.notes):
        print(f"tinysplat: {' '.join(line.split())}", file=sys.stderr)
    if not outcome.rows:
        raise InputError(f"nothing could be measured; {summary_line(outcome)}", where="eval")
    _write(folder, own.json, document(outcome, lpips_text, threads, own.jobs))
    if not own.quiet:
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
