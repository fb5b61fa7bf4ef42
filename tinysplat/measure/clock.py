"""The one clock: CPU seconds of a call, and seconds and peak memory of work in a process of its own.

CPU seconds are those of this process and its children, which neighbours on a shared machine disturb less.
"""

import contextlib
import importlib
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.stopwatch import peak_rss_bytes

Figures = dict[str, Any]

TIMEOUT_S = 3600
"""Of work in a process of its own."""

T = TypeVar("T")


def cpu_of(run: Callable[[], T]) -> tuple[T, float]:
    """What one call gives, and the CPU seconds that it takes."""
    start = _cpu_seconds()
    return run(), _cpu_seconds() - start


def _cpu_seconds() -> float:
    """CPU seconds of this process and of the children that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


# ---- in a process of its own ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Taken:
    """What a piece of work took in a fresh process.

    Attributes:
        total: largest resident memory in bytes while it worked, its input and libraries included.
        before: resident memory in bytes when the work began.
        seconds, cpu: of the work, on the clock and of all its threads.
        figures: what the work returned of itself.
    """

    total: int
    before: int
    seconds: float
    cpu: float
    figures: Figures


def measure_apart(task: str, *arguments: object) -> Taken:
    """Memory and seconds of a piece of work in a fresh process.

    Args:
        task: dotted name of a function of strings, such as `tinysplat.measure.studies.growth.draw_cloud`, that loads
            what is needed and returns the work as a call, which returns figures or nothing.
        arguments: the strings.

    Raises:
        TinySplatError: the process failed, and its last line says why, or took longer than `TIMEOUT_S`.
    """
    command = [sys.executable, "-m", __name__, task, *map(str, arguments)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise TinySplatError(f"took more than {TIMEOUT_S} s", where=task) from None
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise TinySplatError(lines[-1], where=task)
    return Taken(**json.loads(done.stdout))


def _high_water_mark() -> int:
    """Peak resident memory of this process, bytes.

    On Linux `VmHWM` of /proc/self/status: `ru_maxrss` would start at the parent's size, which exec hands down.
    """
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024
    return peak_rss_bytes()


def _child(task: str, *arguments: str) -> None:
    """Do one task in this process and print what it took as JSON."""
    module, _, name = task.rpartition(".")
    work = getattr(importlib.import_module(module), name)(*arguments)
    with contextlib.suppress(OSError):  # not on Linux: the peak of loading counts too
        Path("/proc/self/clear_refs").write_text("5")
    before, start = _high_water_mark(), (time.perf_counter(), time.process_time())
    figures = work() or {}
    seconds, cpu = time.perf_counter() - start[0], time.process_time() - start[1]
    print(json.dumps(asdict(Taken(_high_water_mark(), before, seconds, cpu, figures))))


if __name__ == "__main__":
    _child(*sys.argv[1:])
