"""`tinysplat bench`: error against run time of every stage, as a folder with tables and plots."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence

from tinysplat.bench.agreement import read_report
from tinysplat.bench.inputs import user_inputs
from tinysplat.bench.network import shipped_networks
from tinysplat.bench.report import Report, write_report
from tinysplat.bench.run import compared, run_bench
from tinysplat.bench.sections import FULL, QUICK, SECTIONS, Bench
from tinysplat_runtime.api import DEFAULT_MODEL, Runtime
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs.artifacts import find_artifact

HELP = "error against run time, report with plots"

DEFAULT_FOLDER = "bench_report"


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Measure seconds, memory, bytes and errors of every stage, and write a folder with report.md, report.json and"
        " plots. Without INPUT it measures on scenes of its own."
    )
    parser.add_argument(
        "inputs", nargs="*", metavar="INPUT", help="scene folders with eval_index.json, or Gaussian files"
    )
    parser.add_argument("-o", "--output", default=DEFAULT_FOLDER, metavar="FOLDER",
                        help=f"the report's folder; default {DEFAULT_FOLDER}")  # fmt: skip
    parser.add_argument(
        "--quick",
        action="store_true",
        help="the short form: smaller pictures, fewer variants, minutes in place of half an hour",
    )
    parser.add_argument("--stages", type=stages, default=tuple(SECTIONS), metavar="S,S",
                        help=f"some of {','.join(SECTIONS)}; default all")  # fmt: skip
    parser.add_argument("--model", action="append", metavar="NAME|FILE.onnx",
                        help="network, may be repeated; default all in the manifest")  # fmt: skip
    parser.add_argument("--against", metavar="FOLDER", help="an earlier report to compare with")


def stages(text: str) -> tuple[str, ...]:
    """`codec,peers` to a tuple, in the report's order."""
    asked = [part.strip() for part in text.split(",")]
    for name in asked:
        if name not in SECTIONS:
            raise ArgumentTypeError(f"'{name}', expected some of {','.join(SECTIONS)}")
    return tuple(name for name in SECTIONS if name in asked)


def run(args: Namespace) -> None:
    """Measure, write the folder, print the main lines."""
    try:
        _run(args)
    except ImportError as error:  # matplotlib, torch
        raise InputError(
            f"needs the package '{error.name}'; pip install \"tinysplat[eval]\" brings it", where="bench"
        ) from None


def _run(args: Namespace) -> None:
    if args.against is not None:
        read_report(args.against)  # what cannot be read is said now, not in half an hour
    for model in args.model or ():
        find_artifact(model, "network")  # so is a name that does not exist
    scenes, files, left_out = user_inputs(args.inputs)
    runtime = Runtime(threads=args.threads)
    bench = Bench(QUICK if args.quick else FULL, runtime, scenes, files, _models(args.model), left_out)
    report = run_bench(bench, args.stages, quiet=args.quiet)
    if args.against is not None:
        report = compared(report, args.against)
    path = write_report(args.output, report)
    if not args.quiet:
        print("\n".join(_summary(report)))
    print(path)


def _models(named: Sequence[str] | None) -> list[str]:
    if named:
        return list(named)
    shipped = shipped_networks()
    return sorted(shipped, key=lambda name: (name != DEFAULT_MODEL, name))  # the default one codes the other stages


def _summary(report: Report) -> list[str]:
    timed = [row for row in report.rows if row.seconds is not None]
    minutes = sum(report.section_seconds.values()) / 60
    lines = [f"{len(timed)} rows in {minutes:.1f} minutes"]
    lines += report.left_out
    if report.agreement is not None:
        lines += report.agreement.lines()
    return lines
