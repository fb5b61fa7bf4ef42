"""One line of a table: what was measured on a case, three ways, and the bound that ours must keep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

EPS32 = 2.0**-24
"""Unit roundoff of float32."""

EPS64 = 2.0**-53


@dataclass(frozen=True)
class NumericRow:
    """One case.

    Attributes:
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

    transform: str
    case: str
    measure: str
    condition: float
    plain: float
    ours: float
    double: float
    bound: float
    mitigation: str = ""

    @property
    def holds(self) -> bool:
        """Whether ours keeps the bound; NaN does not."""
        return self.ours <= self.bound


HEAD = (
    "| case | measure | condition | float32 | ours | float64 | bound | mitigation |\n|---|---|---|---|---|---|---|---|"
)


def table(rows: Sequence[NumericRow]) -> str:
    """A Markdown table."""
    return "\n".join([HEAD, *(_line(row) for row in rows)])


def _line(row: NumericRow) -> str:
    numbers = (row.condition, row.plain, row.ours, row.double, row.bound)
    return f"| {row.case} | {row.measure} | {' | '.join(map(show, numbers))} | {row.mitigation} |"


def show(value: float) -> str:
    """Two digits, as people read them: 0, 3.1e-08, 120, ∞."""
    if value != value:
        return "NaN"
    if value in (float("inf"), float("-inf")):
        return "∞"
    return f"{value:.2g}"
