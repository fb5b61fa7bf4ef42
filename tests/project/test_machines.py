"""`make test-machines`: its runs cover every setting, and what it may leave out is there to be left out."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_every_setting_is_in_a_run_that_it_can_be_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / ".ci"))
    machines = importlib.import_module("machines")
    assert {setting for run in machines.RUNS for setting in run} == set(machines.SETTINGS)
    assert len(set(machines.RUNS)) == len(machines.RUNS) and () in machines.RUNS
    for kind in (machines.KERNELS, machines.VECTORS, machines.CORES, machines.ENDS):
        assert all(len(set(kind) & set(run)) <= 1 for run in machines.RUNS)
    assert all((ROOT / path).exists() for path in machines.NO_NUMBERS)
