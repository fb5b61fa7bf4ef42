"""The process in which usd-core reads, by forking in place of starting Python: a hundred times as fast.

The child runs the product's own worker; what the parent sees is what `subprocess.run` would give it. Threads of a
library are not forked with it, and a child may wait for one for ever: then a process of its own reads.
"""

import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from tinysplat_runtime.formats import usd_worker

MOST_MEMORY_KB = 1 << 20
MOST_CPU_S = 2.0
STUCK_S = 20.0
RUN = subprocess.run


@contextmanager
def forked_usd_worker() -> Iterator[None]:
    """Within the block, USD files are read by forked children, held to bounds of memory and time."""
    from pxr import Sdf, Usd, UsdGeom  # noqa: F401, once, before the first fork

    def run(command: Sequence[str], **_: Any) -> subprocess.CompletedProcess[str]:
        done = _forked(command, lambda: usd_worker.main(command[3], command[4], int(command[5])))
        texts = (data.decode(errors="replace") for data in (done.stdout, done.stderr))
        return subprocess.CompletedProcess(command, done.returncode, *texts)

    with mock.patch.object(subprocess, "run", run):
        yield


def _forked(command: Sequence[str], work: Callable[[], int]) -> subprocess.CompletedProcess[bytes]:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        inherited_kb = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1024
        child = os.fork()
        if not child:
            _work(work, out.fileno(), err.fileno())
        began, ended = time.monotonic(), (0, 0, None)
        while not ended[0]:
            time.sleep(0.0005)
            ended = os.wait4(child, os.WNOHANG)
            if not ended[0] and time.monotonic() - began > STUCK_S:
                os.kill(child, signal.SIGKILL)
                os.wait4(child, 0)
                return RUN(command, capture_output=True, check=False, timeout=STUCK_S)
        _, status, used = ended
        seconds, memory_kb = used.ru_utime + used.ru_stime, used.ru_maxrss - inherited_kb
        if seconds > MOST_CPU_S or memory_kb > MOST_MEMORY_KB:
            raise AssertionError(f"the worker took {seconds:.1f} CPU seconds and {memory_kb} KB")
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(command, os.waitstatus_to_exitcode(status), out.read(), err.read())


def _work(work: Callable[[], int], out: int, err: int) -> None:
    """Never returns: whatever is raised here must not run on as a second test session."""
    status = 1
    try:
        os.dup2(out, 1)
        os.dup2(err, 2)
        with os.fdopen(os.dup(1), "w") as sys.stdout, os.fdopen(os.dup(2), "w") as sys.stderr:
            status = work()
    finally:
        os._exit(status)
