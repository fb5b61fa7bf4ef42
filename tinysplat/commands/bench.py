"""`tinysplat bench`: studies of speed, size and error as rows, a report and plots; and the figures of our pages."""

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tinysplat.measure.machine import run_row
from tinysplat.measure.pages import fill_pages, write_report
from tinysplat.measure.rows import ROWS, Row, RowFile
from tinysplat.measure.studies import ORDINARY, STUDIES, find_study
from tinysplat.measure.study import Run, StudyOptions
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.cli.asks import Quiet
from tinysplat_runtime.cli.files import Threads
from tinysplat_runtime.cli.options import add_options, asked
from tinysplat_runtime.cli.outputs import made_folder
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.graphs.artifacts import find_artifact
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.options import flag, option
from tinysplat_runtime.system.voice import Voice

HELP = "error against run time, report with plots"
NEEDS = ("matplotlib",)

DEFAULT_FOLDER = "bench_report"

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, kw_only=True)
class Bench(Threads, Quiet):
    """What the command asks for."""

    words: tuple[str, ...] = option(
        kinds.text,
        (),
        is_bare=True,
        is_many=True,
        metavar="STUDY … INPUT …",
        help="studies, then scene folders or Gaussian files",
    )
    output: str = option(
        kinds.path, DEFAULT_FOLDER, short="o", metavar="FOLDER", help=f"the report's folder; default {DEFAULT_FOLDER}"
    )
    quick: bool = flag(help="the short form: smaller pictures, fewer variants")
    docs: bool = flag(help="fill pages from rows")
    model: str = option(kinds.text, DEFAULT_MODEL, metavar="NAME|FILE.onnx", help=f"network; default {DEFAULT_MODEL}")


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.usage = "tinysplat bench [STUDY …] [INPUT …] [options]"
    parser.description = (
        "Measure, and write a folder with rows.jsonl, report.md and plots. Words that name studies come first; without"
        f" any, {', '.join(ORDINARY)} are measured; without INPUT, on scenes of its own. Studies"
        f" (docs/MEASURING.md): {', '.join(STUDIES)}."
    )
    add_options(parser, Bench, StudyOptions)


def run(args: Namespace) -> None:
    """Measure, write the folder, print the main lines."""
    own, options = asked(args, Bench), asked(args, StudyOptions)
    if own.docs:
        _fill(quiet=own.quiet)
        return
    studies, inputs = split_words(own.words)
    find_artifact(own.model, "network")
    folder = made_folder(own.output)
    bench = Run(own.quick, Runtime(threads=own.threads), RowFile(folder / ROWS), inputs, own.model, options)
    measured = measure_studies(bench, studies, quiet=own.quiet)
    if not measured:
        raise InputError("; ".join(bench.left_out[:1]) or "nothing could be measured", where="bench")
    path = write_report(folder, list(bench.store), bench.left_out)
    if not own.quiet:
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
