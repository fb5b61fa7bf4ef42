"""Where the time goes: a call's own seconds, and that every part of the table is still called where it is timed."""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import tinysplat_runtime as ts
from tests.scenes import make_smooth_gaussians
from tinysplat_runtime.render import Renderer


@pytest.fixture(scope="module")
def stages() -> ModuleType:
    folder = str(Path(__file__).resolve().parents[2] / "benchmarks")
    sys.path.insert(0, folder)
    try:
        return importlib.import_module("stages")
    finally:
        sys.path.remove(folder)


def test_a_call_does_not_count_what_timed_calls_within_it_take(
    stages: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)

    def pass_time(seconds: float) -> None:
        nonlocal now
        now += seconds

    clock = stages.OwnTime()
    inner = clock.timed("inner", pass_time)

    def outer() -> None:
        pass_time(1.0)
        inner(10.0)
        inner(20.0)

    clock.timed("outer", outer)()
    assert clock.seconds == {"inner": 30.0, "outer": 1.0}


def test_every_part_of_decoding_is_timed(stages: ModuleType) -> None:
    runtime = ts.Runtime(threads=1)
    data = runtime.compress(make_smooth_gaussians(1, 16, 24, 1))
    seconds = stages.once(lambda: runtime.decompress(data), stages.DECODE)
    assert set(seconds) == {*stages.DECODE, stages.REST} and min(seconds.values()) > 0
    operators = stages.graph_operators(runtime, data, rounds=1)
    assert len(operators) == 1 and {"SH product", "Transpose", "other operators"} <= set(operators[0])


def test_every_part_of_a_frame_is_timed_and_the_picture_is_the_same(stages: ModuleType) -> None:
    gaussians = make_smooth_gaussians(1, 16, 24, 1)
    drawn, pictures = Renderer(gaussians, 1, compiled=False), []
    pictures.append(drawn.render(gaussians.cameras[0]))
    seconds = stages.once(lambda: pictures.append(drawn.render(gaussians.cameras[0])), stages.FRAME)
    assert set(seconds) == {*stages.FRAME, stages.REST} and min(seconds.values()) > 0
    np.testing.assert_array_equal(*pictures)
