"""How much do the transforms lose to rounding, at the ends? Errors of plain float32, of what ships, and of float64,
against 50 digits of mpmath, each row with the bound that it must keep (`tests/measure/test_conditioning.py`). Error
against run time is the study `transforms`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from tinysplat.measure.rows import Row, grouped, of_study
from tinysplat.measure.show.plots import Curve, Panel, save_grid
from tinysplat.measure.show.tables import ABSENT, Listing, format_table, mean, said, small
from tinysplat.measure.study import Run, Study
from tinysplat_runtime.graphs.inference import GraphStore

from . import pictures, projection, reduction
from .exact import STUDY, holds

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


def worst_table(rows: Sequence[Row]) -> str:
    """The case of each transform that comes nearest to its bound."""
    lines = []
    for (transform,), members in grouped(of_study(rows, STUDY), "subject").items():
        row = max(members, key=lambda row: row.figures["ours"] / row.figures["bound"])
        figures = [small(row.figures[name]) for name in ("condition", *WAYS, "bound")]
        lines.append([transform, str(len(members)), f"{row.setting['case']}: {row.setting['measure']}", *figures])
    heads = ["transform", "cases", "nearest to its bound", "condition", *WAYS, "bound"]
    return format_table(heads, lines) if lines else ""


def plot_errors(path: Path, rows: Sequence[Row]) -> bool:
    """Every case's three errors and its bound, a panel per transform."""
    panels = []
    for (transform,), members in grouped(of_study(rows, STUDY), "subject").items():
        curves = [
            Curve(name, [(i + 1, min(max(row.figures[name], _EXACT), 10.0)) for i, row in enumerate(members)],
                  is_line=False)
            for name in (*WAYS, "bound")
        ]  # fmt: skip
        panels.append(Panel(transform, "case, in the table's order", "error (0 drawn at 1e-17)", curves, log="y"))
    if panels:
        save_grid(path, "Errors against 50 digits", [panels[:3], panels[3:]])
    return bool(panels)


_ERRORS = {name: mean(name, small) for name in ("condition", *WAYS, "bound")}


def _bounds(transform: str) -> Listing:
    """Every case of a transform."""
    columns = {"case": said("case"), "measure": said("measure"), **_ERRORS}
    return Listing(STUDY, columns, wanted=lambda row: row.subject == transform)


_FLOOR = Listing(
    "floor",
    {"cameras": said("subject"), "weighting": said("way"), "least λ": mean("least", small),
     "condition of Δ": mean("condition", small), "noise in coefficients": mean("amplification", small),
     "in colour seen": mean("seen", small), "10° beside": mean("beside", small),
     "float32 round trip": mean("round_trip", small)},
    wanted=lambda row: row.subject not in ("60°, turned", "5°, on an axis"),  # between those that are shown
)  # fmt: skip
_QUANTISER = Listing(
    "quantiser",
    {"plane": said("way"), "step wanted": mean("wanted", small),
     "step reached": mean("reached", lambda step: small(step) if step else ABSENT), "coded as": said("what"),
     "error of codes, steps": lambda rows: small(rows[0].figures["error"]) + _unit(rows[0]),
     "clipped": lambda rows: f"{rows[0].figures['clipped']} of 4096"},
    wanted=lambda row: not row.way.startswith("range of 1e"),  # as σ = 0 and as any other
)  # fmt: skip


def _unit(row: Row) -> str:
    return "" if row.figures["reached"] else " (units)"


NUMERICS = Study(
    "Conditioning",
    rows_of,
    {"numerics worst": worst_table, **{name: _bounds(name) for name in TRANSFORMS}, "floor": _FLOOR,
     "quantiser": _QUANTISER},
    {"numerics_errors": plot_errors},
)  # fmt: skip
