"""Questions: what each measures, and the tables and plots that answer it. No study imports another.

STUDIES is the one place that lists them, by the words of `tinysplat bench`; a study is imported when it is asked for.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..study import Study

STUDIES = {
    "formats": "interchange.INTERCHANGE",
    "list": "lists.LIST",
    "growth": "growth.GROWTH",
    "walk": "walking.WALK",
    "gate": "gate.GATE",
    "rates": "rates.RATES",
    "poses": "placing.PLACING",
}
"""By name, where it stands in this package; docs/MEASURING.md says what it asks."""

ORDINARY = ("formats", "growth")
"""What is measured where no study is named."""


def find_study(name: str) -> Study:
    """A study of STUDIES."""
    module, _, attribute = STUDIES[name].partition(".")
    return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
