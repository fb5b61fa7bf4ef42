"""Seconds by stage add up, and memory is what the system says."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

from tinysplat_runtime.system.stopwatch import Stopwatch, peak_rss_bytes


def test_stages_add_up_even_where_they_fail() -> None:
    watch = Stopwatch()
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), watch.stage("a"):
            time.sleep(0.02)
            raise ZeroDivisionError
    watch.add("b", 1.5)
    watch.add("b", 2)
    assert 0.04 <= watch.seconds["a"] < 20 and watch.seconds["b"] == 3.5


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")
def test_the_peak_is_what_the_system_says_in_bytes() -> None:
    lines = Path("/proc/self/status").read_text().splitlines()
    told = next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    assert peak_rss_bytes() == pytest.approx(told, rel=0.1)
