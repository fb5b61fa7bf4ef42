"""`tinysplat bench`: studies of speed, size and error as rows, a report and plots; and the figures of our pages."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from tinysplat.measure.machine import run_row
from tinysplat.measure.pages import fill_pages, write_report
from tinysplat.measure.rows import ROWS, Row, RowFile
from tinysplat.measure.studies import ORDINARY, STUDIES, find_study
from tinysplat.measure.study import Options, Run
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.cli.arguments import indices, size
from tinysplat_runtime.cli.options import add_threads
from tinysplat_runtime.cli.outputs import made_folder
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.system.voice import Voice

from .eval import numbers

HELP = "error against run time, report with plots"
NEEDS = ("matplotlib",)

DEFAULT_FOLDER = "bench_report"

ROOT = Path(__file__).resolve().parents[2]


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.usage = "tinysplat bench [STUDY …] [INPUT …] [options]"
    parser.description = (
        "Measure, and write a folder with rows.jsonl, report.md and plots. Words that name studies come first; without"
        f" any, {', '.join(ORDINARY)} are measured; without INPUT, on scenes of its own. Studies"
        f" (docs/MEASURING.md): {', '.join(STUDIES)}."
    )
    parser.add_argument(
        "words", nargs="*", metavar="STUDY … INPUT …", help="studies, then scene folders or Gaussian files"
    )
    parser.add_argument(
        "-o",
        "--output",
        default=DEFAULT_FOLDER,
        metavar="FOLDER",
        help=f"the report's folder; default {DEFAULT_FOLDER}",
    )
    parser.add_argument("--quick", action="store_true", help="the short form: smaller pictures, fewer variants")
    parser.add_argument("--docs", action="store_true", help="fill pages from rows")
    parser.add_argument(
        "--model", default=DEFAULT_MODEL, metavar="NAME|FILE.onnx", help=f"network; default {DEFAULT_MODEL}"
    )
    add_threads(parser)
    of = parser.add_argument_group("options of some studies")
    of.add_argument("--qp", dest="qps", type=numbers, default=(), metavar="Q,Q", help="Q_g; default the study's")
    of.add_argument("--views", type=indices, default=(), metavar="N,N", help="numbers of photos; growth, walk")
    of.add_argument("--limit", type=int, metavar="N", help="measure only lists, up to this size; growth")
    of.add_argument("--size", type=size, metavar="WxH", help="of photos; default 256x256, quick 128x128")
    of.add_argument("--drawn", type=size, metavar="WxH", help="of pictures to judge; default --size; walk, gate")
    of.add_argument("--mode", metavar="MODE", help="of files, as of encode; gate")


def run(args: Namespace) -> None:
    """Measure, write the folder, print the main lines."""
    if args.docs:
        _fill(quiet=args.quiet)
        return
    studies, inputs = split_words(args.words)
    find_artifact(args.model, "network")
    folder = made_folder(args.output)
    options = Options(**{one.name: getattr(args, one.name) for one in fields(Options)})
    bench = Run(args.quick, Runtime(threads=args.threads), RowFile(folder / ROWS), inputs, args.model, options)
    measured = measure_studies(bench, studies, quiet=args.quiet)
    if not measured:
        raise InputError("; ".join(bench.left_out[:1]) or "nothing could be measured", where="bench")
    path = write_report(folder, list(bench.store), bench.left_out)
    if not args.quiet:
        print("\n".join([f"{len(measured)} rows", *bench.left_out]))
    print(path)


def split_words(given: Sequence[str]) -> tuple[tuple[str, ...], list[Path]]:
    """Studies, and inputs behind them; InputError for a word that is neither."""
    count = next((i for i, word in enumerate(given) if word not in STUDIES), len(given))
    for word in given[count:]:
        if not Path(word).exists():
            raise InputError(f"neither a study ({', '.join(STUDIES)}) nor a file or folder", where=word)
    return tuple(given[:count]) or ORDINARY, list(map(Path, given[count:]))


def measure_studies(bench: Run, studies: Sequence[str], *, quiet: bool) -> list[Row]:
    """Rows of studies, kept as they come; what ends one is noted and the next begins."""
    began, rows = time.perf_counter(), []
    for name in Voice(quiet).progress("bench", studies):
        try:
            for row in find_study(name).measure(bench):
                rows.append(bench.store.add(row))
        except TinySplatError as error:
            if len(studies) == 1 and not rows:
                raise
            bench.left_out.append(f"left out the rest of {name}: {error}")
    bench.store.add(run_row(" ".join(studies), began, quick=bench.quick))
    return rows


def _fill(*, quiet: bool) -> None:
    if not (ROOT / "README.md").is_file():
        raise InputError("--docs fills the pages of a checkout, which this installation is not part of", where="bench")
    changed = fill_pages(ROOT)
    if not quiet:
        print("\n".join(str(path.relative_to(ROOT)) for path in changed) or "every figure is that of its rows")
