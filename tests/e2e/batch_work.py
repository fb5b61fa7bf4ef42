"""Work for tests of the batch engines: needs no network, and kills its worker where a job is named so."""

import os
import signal
import time
from pathlib import Path
from typing import Any

from tinysplat.batch.jobs import BatchJob
from tinysplat_runtime.errors import InputError


def note(job: BatchJob) -> dict[str, Any]:
    """Write a file; a scene called `killer` kills its own worker the first time, `poison` every time."""
    marker = Path(job.output).with_suffix(".killed")
    if job.name == "poison" or (job.name == "killer" and not marker.exists()):
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if job.name == "flaky" and not marker.exists():
        marker.touch()
        raise OSError("storage is away")
    if job.name == "bad":
        raise InputError("no frames", where=job.scene)
    time.sleep(0.05)
    with Path(job.output).open("a") as file:
        file.write("done\n")
    return {"bytes": 5, "worker": os.getpid()}
