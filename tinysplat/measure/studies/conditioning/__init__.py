"""How much do the transforms lose to rounding, at the ends? Errors of plain float32, of what ships, and of float64,
against 50 digits of mpmath, each row with the bound that it must keep (`tests/unit/test_conditioning.py`). Error
against run time is the study `transforms`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from tinysplat.measure.rows import Row, grouped
from tinysplat.measure.show.plots import Curve, Panel, save_grid
from tinysplat.measure.show.tables import format_table, small
from tinysplat.measure.study import Run, Study
from tinysplat_runtime.graphs.inference import GraphStore

from . import pictures, projection, reduction
from .bounds import STUDY, holds

WAYS = ("float32", "ours", "float64")
TRANSFORMS = ("VPT", "VPT⁻¹", "Quat(R)", "VABR", "SH", "EWA")
_EXACT = 1e-17
"""Where errors of 0 stand on a logarithmic axis."""


def numeric_rows(store: GraphStore) -> Iterator[Row]:
    """Rows of all transforms that have a bound."""
    yield from projection.projection_rows(store)
    yield from projection.inverse_rows(store)
    yield from projection.rotation_rows()
    yield from reduction.spectrum_rows()
    yield from pictures.sh_rows()
    yield from pictures.splat_rows()


def rows_of(run: Run) -> Iterator[Row]:
    """Bounds, floors of VABR's weighting, and the quantiser."""
    store = GraphStore(threads=1)
    for row in numeric_rows(store):
        if not holds(row):
            run.left_out.append(f"NOT WITHIN ITS BOUND: {row.subject}, {row.way}")
        yield row
    yield from reduction.floor_rows()
    yield from pictures.quantiser_rows()


def bound_table(transform: str, rows: Sequence[Row]) -> str:
    """Every case of a transform."""
    lines = [
        [row.setting["case"], row.setting["measure"],
         *(small(row.figures[name]) for name in ("condition", *WAYS, "bound")), row.setting["mitigation"]]
        for row in rows
        if (row.study, row.subject) == (STUDY, transform)
    ]  # fmt: skip
    heads = ["case", "measure", "condition", *WAYS, "bound", "mitigation"]
    return format_table(heads, lines) if lines else ""


def worst_table(rows: Sequence[Row]) -> str:
    """The case of each transform that comes nearest to its bound."""
    lines = []
    for (transform,), members in grouped((row for row in rows if row.study == STUDY), "subject").items():
        row = max(members, key=lambda row: row.figures["ours"] / row.figures["bound"])
        figures = [small(row.figures[name]) for name in ("condition", *WAYS, "bound")]
        lines.append([transform, str(len(members)), f"{row.setting['case']}: {row.setting['measure']}", *figures])
    heads = ["transform", "cases", "nearest to its bound", "condition", *WAYS, "bound"]
    return format_table(heads, lines) if lines else ""


def floor_table(rows: Sequence[Row]) -> str:
    """The floors of VABR's weighting."""
    names = ("least", "condition", "amplification", "seen", "beside", "round_trip")
    lines = [[row.subject, row.way, *(small(row.figures[name]) for name in names)]
             for row in rows if row.study == "floor"]  # fmt: skip
    heads = ["cameras", "weighting", "least λ", "condition of Δ", "noise in coefficients", "in colour seen",
             "10° beside", "float32 round trip"]  # fmt: skip
    return format_table(heads, lines) if lines else ""


def quantiser_table(rows: Sequence[Row]) -> str:
    """Planes that strain 12 bits."""
    lines = []
    for row in (row for row in rows if row.study == "quantiser"):
        f = row.figures
        reached, unit = (small(f["reached"]), "") if f["reached"] else ("–", " (units)")
        clipped = f"{f['clipped']} of 4096"
        lines.append([row.way, small(f["wanted"]), reached, row.setting["what"], small(f["error"]) + unit, clipped])
    heads = ["plane", "step wanted", "step reached", "coded as", "error of codes, steps", "clipped"]
    return format_table(heads, lines) if lines else ""


def plot_errors(path: Path, rows: Sequence[Row]) -> bool:
    """Every case's three errors and its bound, a panel per transform."""
    panels = []
    for (transform,), members in grouped((row for row in rows if row.study == STUDY), "subject").items():
        curves = [
            Curve(name, [(i + 1, min(max(row.figures[name], _EXACT), 10.0)) for i, row in enumerate(members)],
                  is_line=False)
            for name in (*WAYS, "bound")
        ]  # fmt: skip
        panels.append(Panel(transform, "case, in the table's order", "error (0 drawn at 1e-17)", curves, log="y"))
    if panels:
        save_grid(path, "Errors against 50 digits", [panels[:3], panels[3:]])
    return bool(panels)


_BOUNDS: dict[str, Callable[[Sequence[Row]], str]] = {name: partial(bound_table, name) for name in TRANSFORMS}

NUMERICS = Study(
    "Conditioning",
    rows_of,
    {"numerics worst": worst_table, **_BOUNDS, "floor": floor_table, "quantiser": quantiser_table},
    {"numerics_errors": plot_errors},
)
