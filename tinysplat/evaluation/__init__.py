"""Measuring the chain on photos that the network never saw: what `tinysplat eval`, `compare` and the paper's tables do.

    sources → measure → records → tables

`sources` says what there is to measure (windows of scene folders, data-set chunks, Gaussian files) and brings it to
Gaussians; `measure` codes, decodes, renders and compares one window; `records` keeps results on disk as they come;
`runner` spreads windows over processes; `summary` and `tables` condense them.
"""

from __future__ import annotations

from .measure import Prepared, measure_coding, prepare
from .records import Record, ResultStore
from .runner import Coding, Outcome, Plan, Settings, evaluate
from .scene_index import Window
from .sources import Case, LeftOut, Source, find_sources

__all__ = [
    "Case",
    "Coding",
    "LeftOut",
    "Outcome",
    "Plan",
    "Prepared",
    "Record",
    "ResultStore",
    "Settings",
    "Source",
    "Window",
    "evaluate",
    "find_sources",
    "measure_coding",
    "prepare",
]
