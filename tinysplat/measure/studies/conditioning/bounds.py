"""One line of a table: a case measured three ways, and the bound that ours must keep."""

from __future__ import annotations

from tinysplat.measure.rows import Row

EPS32 = 2.0**-24
"""Unit roundoff of float32."""

EPS64 = 2.0**-53

STUDY = "numerics"


def numeric_row(
    transform: str,
    case: str,
    measure: str,
    condition: float,
    *,
    plain: float,
    ours: float,
    double: float,
    bound: float,
    mitigation: str = "",
) -> Row:
    """A row of the study.

    Args:
        transform: the table it belongs to.
        case: what is extreme about it.
        measure: what the errors are of, and in which unit.
        condition: how much the result moves per relative movement of its inputs.
        plain: error of float32 arithmetic straight from the formulas.
        ours: error of what ships.
        double: error of float64 arithmetic.
        bound: that `ours` must keep, from the condition number.
        mitigation: what makes ours better than plain, or what is refused.
    """
    figures = {"condition": condition, "float32": plain, "ours": ours, "float64": double, "bound": bound}
    return Row(STUDY, transform, f"{case}; {measure}", {"case": case, "measure": measure, "mitigation": mitigation},
               {name: float(value) for name, value in figures.items()})  # fmt: skip


def holds(row: Row) -> bool:
    """Whether ours keeps the bound; NaN does not."""
    return bool(row.figures["ours"] <= row.figures["bound"])
