"""One run: sections in order, what fails noted and passed over; and its comparison with an earlier one."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace

from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.files import StrPath
from tinysplat_runtime.system.progress import progress

from .agreement import compare_reports, read_report
from .machine import describe_machine
from .report import Report, finite_json
from .sections import SECTIONS, Bench
from .timing import Row


def run_bench(bench: Bench, stages: Sequence[str], *, quiet: bool) -> Report:
    """Measure the named sections.

    Args:
        bench: plan and inputs.
        stages: keys of `SECTIONS`.
        quiet: no progress bar.
    """
    machine = describe_machine()
    rows: list[Row] = []
    section_seconds: dict[str, float] = {}
    for name in progress(stages, len(stages), "bench", quiet=quiet):
        start = time.perf_counter()
        try:
            rows.extend(SECTIONS[name](bench))
        except TinySplatError as error:
            bench.left_out.append(f"left out the rest of {name}: {error}")
        section_seconds[name] = time.perf_counter() - start
    load = [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else None
    return Report(bench.plan.name, machine, rows, section_seconds, tuple(bench.left_out), load)


def compared(report: Report, against: StrPath) -> Report:
    """The report with what it has in common with an earlier one.

    Raises:
        InputError: `against` is no report.
    """
    return replace(report, agreement=compare_reports(read_report(against), finite_json(report.to_json())))
