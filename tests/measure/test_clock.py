"""What is measured of time and memory is the work's own: children's seconds counted, what was loaded
before the work not.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from scenes import refusing

from tinysplat.measure.clock import measure_apart, timed
from tinysplat_runtime.errors import TinySplatError

HOG = """
import numpy as np
def load(megabytes):
    first = np.ones(int(megabytes) << 20, np.uint8)  # touched, and let go before the work begins
    del first
    def work():
        np.ones(20 << 20, np.uint8)
        return {"megabytes": megabytes}
    return work
"""


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the mark can be set back on Linux alone")
def test_what_was_let_go_before_the_work_is_not_in_its_peak(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hog.py").write_text(HOG)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    small, large = (measure_apart("hog.load", megabytes) for megabytes in (1, 300))
    assert abs(large.total - small.total) < 30e6
    assert large.total - large.before > 15e6
    assert large.figures == {"megabytes": "300"} and large.seconds > 0


def test_a_child_that_fails_says_why(tmp_path: Path) -> None:
    with refusing(TinySplatError, str(tmp_path / "missing")):
        measure_apart("tinysplat.measure.studies.growth.encode_photos", tmp_path / "missing", 1)


def test_cpu_seconds_count_children():
    burn = "import time; end = time.process_time() + 0.3\nwhile time.process_time() < end: pass"
    _, cpu = timed(lambda: subprocess.run([sys.executable, "-c", burn], check=True))
    assert cpu > 0.28
