"""The tables of docs/NUMERICS.md."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tinysplat.measure.rows import Row, grouped
from tinysplat.measure.show.tables import ABSENT, Listing, format_table, mean, said
from tinysplat_runtime.graphs.inference import GraphStore

from . import numeric_rows, pictures, reduction

WAYS = ("float32", "ours", "float64")


def small(value: float) -> str:
    """An error, two significant digits: 0, 3.1e-08, 120, ∞."""
    return f"{value:.2g}" if math.isfinite(value) else "∞"


def worst_table(rows: Sequence[Row]) -> str:
    """The case of each transform that comes nearest to its bound."""
    lines = []
    for (transform,), members in grouped(rows, "subject").items():
        row = max(members, key=lambda row: row.figures["ours"] / row.figures["bound"])
        figures = [small(row.figures[name]) for name in ("condition", *WAYS, "bound")]
        lines.append([transform, str(len(members)), f"{row.setting['case']}: {row.setting['measure']}", *figures])
    heads = ["transform", "cases", "nearest to its bound", "condition", *WAYS, "bound"]
    return format_table(heads, lines)


FLOOR = Listing(
    "floor",
    {
        "cameras": said("subject"),
        "weighting": said("way"),
        "least λ": mean("least", small),
        "condition of Δ": mean("condition", small),
        "noise in coefficients": mean("amplification", small),
        "in colour seen": mean("seen", small),
        "10° beside": mean("beside", small),
        "float32 round trip": mean("round_trip", small),
    },
    wanted=lambda row: row.subject not in ("60°, turned", "5°, on an axis"),  # between those that are shown
)
QUANTISER = Listing(
    "quantiser",
    {
        "plane": said("way"),
        "step wanted": mean("wanted", small),
        "step reached": mean("reached", lambda step: small(step) if step else ABSENT),
        "coded as": said("what"),
        "error of codes, steps": lambda rows: small(rows[0].figures["error"]) + _unit(rows[0]),
        "clipped": lambda rows: f"{rows[0].figures['clipped']} of 4096",
    },
    wanted=lambda row: not row.way.startswith("range of 1e"),  # as σ = 0 and as any other
)


def _unit(row: Row) -> str:
    return "" if row.figures["reached"] else " (units)"


print(worst_table(list(numeric_rows(GraphStore(threads=1)))), end="\n\n")
print(FLOOR(list(reduction.floor_rows())), end="\n\n")
print(QUANTISER(list(pictures.quantiser_rows())))
