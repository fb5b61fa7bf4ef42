"""What is measured of time and memory is the work's own: children's seconds counted, what was loaded before it not."""

from __future__ import annotations

import gc
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

from tinysplat.measure import clock
from tinysplat.measure.clock import (
    Baseline,
    Effort,
    Peak,
    Variant,
    find_task,
    high_water_mark,
    measure,
    measure_peak,
    plural,
    summarised,
    timed,
)
from tinysplat_runtime.errors import InputError, TinySplatError

CHILD = """
import sys, types
import numpy as np
def load(megabytes):
    first = np.ones(int(megabytes) << 20, np.uint8)  # touched, and let go before the work begins
    del first
    return lambda: np.ones(20 << 20, np.uint8)
sys.modules["hog"] = types.SimpleNamespace(load=load)
from tinysplat.measure.clock import _child
_child("hog.load", sys.argv[1])
"""


def peak(megabytes: int) -> dict[str, int]:
    command = [sys.executable, "-c", CHILD, str(megabytes)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the mark can be set back on Linux alone")
def test_what_was_let_go_before_the_work_is_not_in_its_peak():
    small, large = peak(1), peak(300)
    assert abs(large["total"] - small["total"]) < 30e6
    assert large["total"] - large["before"] > 15e6


def test_cpu_seconds_count_children():
    burn = "import time; end = time.process_time() + 0.3\nwhile time.process_time() < end: pass"
    _, cpu = timed(lambda: subprocess.run([sys.executable, "-c", burn], check=True))
    assert cpu > 0.28


# ---- rounds ------------------------------------------------------------------------------------------------------


def test_costs_are_medians_quartiles_and_medians_of_ratios(monkeypatch) -> None:
    """Times are given: wall and CPU seconds of the variant, then of its baseline, round by round."""
    given = iter([(4.0, 8.0), (2.0, 1.0), (9.0, 6.0), (3.0, 2.0), (5.0, 5.0), (1.0, 1.0), (6.0, 1.0), (2.0, 4.0)])
    monkeypatch.setattr(clock, "timed", lambda run: next(given))
    monkeypatch.setattr(clock.gc, "freeze", lambda: None)
    variant = Variant("way", lambda: 7, lambda found: {"found": found}, {"qp": 3}, 2, Baseline("alone", int))
    (row,) = measure("s", "c", [variant], Effort(rounds=4))
    assert (row.study, row.subject, row.way, row.note, row.stamp) == ("s", "c", "way", "", "")
    assert row.setting == {"qp": 3, "threads": 2, "baseline": "alone"} and row.figures == {"found": 7}
    assert row.costs == {
        "seconds": 5.5, "low": 4.75, "high": 6.75, "cpu": 5.5, "rounds": 4,
        "baseline_seconds": 2.0, "ratio": 3.0, "cpu_ratio": 4.0,
    }  # fmt: skip
    assert summarised([(3.0, 2.0)]) == {"seconds": 3.0, "low": 3.0, "high": 3.0, "cpu": 2.0, "rounds": 1}
    assert summarised([(1.0, 1.0), (2.0, 4.0)]) == {"seconds": 1.5, "low": 1.25, "high": 1.75, "cpu": 2.5, "rounds": 2}


@pytest.mark.parametrize(
    ("effort", "done"),
    [
        (Effort(5), 5), (Effort(2), 2), (Effort(9, 10.0), 3), (Effort(9, 15.0), 4), (Effort(9, 15.0, 6), 6),
        (Effort(9, 14.9), 3), (Effort(9, 0.0, 1), 1), (Effort(0), 0),
    ],
)  # fmt: skip
def test_rounds_end_when_the_budget_is_exceeded_but_the_least_are_done(monkeypatch, effort: Effort, done: int) -> None:
    """Every round takes five seconds of a clock that the test turns."""
    now = [100.0]

    def timed(run: object) -> tuple[float, float]:
        now[0] += 5
        return 5.0, 5.0

    monkeypatch.setattr(clock, "timed", timed)
    monkeypatch.setattr(clock.time, "perf_counter", lambda: now[0])
    if done:
        assert [row.costs["rounds"] for row in measure("s", "c", [Variant("v", int)], effort)] == [done]
    assert now[0] == 100 + 5 * done or not done


def test_a_variant_that_cannot_work_is_a_row_behind_the_others() -> None:
    def fails() -> None:
        raise InputError("needs more", where="size")

    rows = measure("s", "c", [Variant("a", fails, setting={"qp": 1}), Variant("b", int)], Effort(1, least=1))
    assert [(row.way, row.note, row.setting) for row in rows] == [
        ("b", "", {"threads": 1}), ("a", "size: needs more", {"qp": 1}),
    ]  # fmt: skip
    assert rows[0].seconds is not None and rows[1].seconds is None and rows[1].costs == {}
    assert not gc.get_freeze_count()


def test_a_call_is_timed_alone_after_idle_threads_have_settled(monkeypatch) -> None:
    slept, ticks = [], iter([10.0, 10.25])
    cpu = iter([3.0, 3.5])
    monkeypatch.setattr(clock.time, "sleep", slept.append)
    monkeypatch.setattr(clock.time, "perf_counter", lambda: next(ticks))
    monkeypatch.setattr(clock, "_cpu_seconds", lambda: next(cpu))
    assert timed(lambda: slept.append(gc.isenabled())) == (0.25, 0.5)
    assert slept == [0.03, False] and gc.isenabled()
    monkeypatch.undo()
    with pytest.raises(ZeroDivisionError):
        timed(lambda: 1 / 0)
    assert gc.isenabled()


def test_efforts_are_without_limit_and_of_three_rounds_unless_they_say_otherwise() -> None:
    assert (Effort(9).budget_s, Effort(9).least, Variant("v", int).threads) == (math.inf, 3, 1)
    assert [plural(n) for n in (1, 2, 8)] == ["1 thread", "2 threads", "8 threads"]


# ---- memory ------------------------------------------------------------------------------------------------------


def test_the_high_water_mark_is_in_bytes() -> None:
    status = Path("/proc/self/status")
    if not status.exists():
        pytest.skip("Linux alone tells")
    line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    assert abs(high_water_mark() - int(line.split()[1]) * 1024) < 5e6


def test_a_task_is_found_by_its_dotted_name() -> None:
    assert find_task("math.sqrt") is math.sqrt and find_task("os.path.join") is __import__("os").path.join


@pytest.mark.parametrize(
    ("status", "words", "said"),
    [(1, "Traceback\nValueError: no\n", "ValueError: no"), (3, "", "exit status 3"), (-9, " \n", "exit status -9")],
)
def test_what_a_child_died_of_is_its_last_line(monkeypatch, status: int, words: str, said: str) -> None:
    asked = []

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess:
        asked.append((command[1:], options["timeout"]))
        return subprocess.CompletedProcess(command, status, "", words)

    monkeypatch.setattr(clock.subprocess, "run", run)
    with pytest.raises(TinySplatError) as caught:
        measure_peak("a.task", 3, Path("x"))
    assert str(caught.value) == f"peak memory of a.task: {said}"
    assert asked == [(["-m", "tinysplat.measure.clock", "a.task", "3", "x"], 300)]


def test_a_peak_is_what_the_child_says(monkeypatch) -> None:
    found = subprocess.CompletedProcess([], 0, '{"total": 7, "before": 5}', "")
    monkeypatch.setattr(clock.subprocess, "run", lambda *_, **__: found)
    assert measure_peak("a.task") == Peak(total=7, before=5)
