"""What is measured of time and memory is the work's own: children's seconds counted, what was loaded
before the work not.
"""

import subprocess
import sys
from pathlib import Path

from scenes import refusing

from tinysplat.measure.clock import cpu_of, measure_apart
from tinysplat_runtime.errors import TinySplatError


def test_a_child_that_fails_says_why(tmp_path: Path) -> None:
    with refusing(TinySplatError, str(tmp_path / "missing")):
        measure_apart("tinysplat.measure.studies.growth.encode_photos", tmp_path / "missing", 1)


def test_cpu_seconds_count_children():
    burn = "import time; end = time.process_time() + 0.3\nwhile time.process_time() < end: pass"
    _, cpu = cpu_of(lambda: subprocess.run([sys.executable, "-c", burn], check=True))
    assert cpu > 0.28
