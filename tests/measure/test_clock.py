"""What is measured of time and memory is the work's own: children's seconds counted, what was loaded before it not."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tinysplat.measure.clock import timed

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
