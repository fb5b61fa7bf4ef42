"""Whether two reports agree: figures that must be identical, and times that should be alike."""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import StrPath, read_limited

REPORT_JSON = "report.json"
_MAX_BYTES = 64 * 1000 * 1000


@dataclass(frozen=True)
class Difference:
    """A figure that should be the same and is not."""

    row: str
    figure: str
    before: float | None
    now: float | None


@dataclass(frozen=True)
class Agreement:
    """What two reports have in common.

    Attributes:
        rows: how many are in both.
        figures: how many figures were compared.
        differences: those that differ.
        ratios: seconds now over seconds before, by row.
        cpu_ratios: the same of CPU seconds.
    """

    rows: int
    figures: int
    differences: tuple[Difference, ...]
    ratios: Mapping[str, float]
    cpu_ratios: Mapping[str, float]

    def lines(self) -> list[str]:
        """The comparison in words, one fact a line."""
        out = [
            f"{self.rows} rows are in both reports; of {self.figures} figures that do not depend on time"
            f" {self.figures - len(self.differences)} are identical and {len(self.differences)} differ."
        ]
        out += [f"  {d.row}: {d.figure} was {d.before}, is {d.now}" for d in self.differences[:20]]
        for name, ratios in (("Seconds", self.ratios), ("CPU seconds", self.cpu_ratios)):
            if len(ratios) > 1:
                low, middle, high = statistics.quantiles(ratios.values(), n=4, method="inclusive")
                out.append(f"{name} now over before: median {middle:.2f}, quartiles {low:.2f} to {high:.2f}.")
        slowest = sorted(self.cpu_ratios.items(), key=lambda item: -item[1])[:5]
        out += [f"  {row}: {ratio:.2f} × the CPU seconds of before" for row, ratio in slowest if ratio > 1.25]
        return out


def read_report(path: StrPath) -> dict[str, Any]:
    """A report's JSON, from its folder or file.

    Raises:
        InputError: there is none, or it is not one.
    """
    file = Path(path) / REPORT_JSON if Path(path).is_dir() else Path(path)
    try:
        document = json.loads(read_limited(file, _MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON ({error})", where=str(file)) from None
    if not isinstance(document, dict) or not isinstance(document.get("rows"), list):
        raise InputError("not a report of `tinysplat bench`", where=str(file))
    return document


def compare_reports(before: Mapping[str, Any], now: Mapping[str, Any]) -> Agreement:
    """Compare the rows that two reports have in common."""
    old = {_name(row): row for row in before["rows"]}
    pairs = [(name, old[name], row) for row in now["rows"] if (name := _name(row)) in old]
    differences, figures = [], 0
    for name, a, b in pairs:
        theirs, ours = a.get("figures", {}), b.get("figures", {})
        keys = sorted({*theirs, *ours})
        figures += len(keys)
        differences += [
            Difference(name, key, theirs.get(key), ours.get(key)) for key in keys if theirs.get(key) != ours.get(key)
        ]
    return Agreement(len(pairs), figures, tuple(differences), _time_ratios(pairs, "median"), _time_ratios(pairs, "cpu"))


def _time_ratios(pairs: Sequence[tuple[str, Any, Any]], key: str) -> dict[str, float]:
    timed = [(name, a["seconds"][key], b["seconds"][key]) for name, a, b in pairs if "seconds" in a and "seconds" in b]
    return {name: now / before for name, before, now in timed if before > 0}


def _name(row: Mapping[str, Any]) -> str:
    return f"{row['stage']} | {row['case']} | {row['variant']}"
