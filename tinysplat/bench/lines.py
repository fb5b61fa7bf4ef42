"""What the scripts in benchmarks/ share: their options, and one JSON line per case."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Sequence
from typing import Any

from tinysplat_runtime.api import DEFAULT_MODEL, Runtime

from .inputs import user_inputs
from .machine import commit, package_versions, processor_name
from .report import finite_json
from .sections import FULL, QUICK, Bench
from .timing import Row


def parse_options(description: str, tasks: Sequence[str] = ()) -> Namespace:
    """`INPUT … [--quick] [--threads N]` of the command line, and `[--tasks …]` where there are some to choose from."""
    parser = ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("inputs", nargs="*", metavar="INPUT", help="scene folders with eval_index.json, Gaussian files")
    parser.add_argument("--quick", action="store_true", help="the short form")
    parser.add_argument("--threads", type=int, metavar="N", help="default: all cores")
    if tasks:
        parser.add_argument("--tasks", nargs="+", choices=tasks, default=tasks, metavar="TASK", help="default: all")
    return parser.parse_args()


def make_bench(options: Namespace) -> Bench:
    """A run as the options say."""
    scenes, files, left_out = user_inputs(options.inputs)
    plan = QUICK if options.quick else FULL
    return Bench(plan, Runtime(threads=options.threads), scenes, files, [DEFAULT_MODEL], left_out)


def print_rows(rows: Iterable[Row]) -> list[Row]:
    """Print each row as one JSON line as soon as it is there, with what it was measured on; returns them all."""
    machine = {"processor": processor_name(), "commit": commit(), "packages": package_versions()}
    printed = []
    for row in rows:
        print_line(row.to_json() | {"machine": machine})
        printed.append(row)
    return printed


def print_line(fields: dict[str, Any]) -> None:
    """One JSON line."""
    print(json.dumps(finite_json(fields), ensure_ascii=False, allow_nan=False), flush=True)
