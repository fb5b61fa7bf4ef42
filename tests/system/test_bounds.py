"""Bounds of a process: more memory or time than asked for is not given."""

import subprocess
import sys

import pytest

RUN = """
import sys
from tinysplat_runtime.formats.usd_worker import bound_process
bound_process(100 << 20, 1)
try:
    held = bytearray(int(sys.argv[1]) << 20)
except MemoryError:
    sys.exit("no memory")
while sys.argv[2] == "busy":
    pass
"""


@pytest.mark.parametrize(("megabytes", "busy", "ends"), [(50, "", 0), (150, "", 1), (1, "busy", None)])
def test_a_process_takes_what_it_may_and_no_more(megabytes: int, busy: str, ends: int | None) -> None:
    command = [sys.executable, "-c", RUN, str(megabytes), busy]
    done = subprocess.run(command, capture_output=True, check=False, timeout=60)
    assert done.returncode == ends if ends is not None else done.returncode < 0
    assert (b"no memory" in done.stderr) == (ends == 1)
