"""One scene of a batch evaluated: what `tinysplat eval` measures of it, as one JSON file."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import time
from pathlib import Path

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.jsonfields import JsonObject

from .jobs import BatchJob, worker_runtime
from .storage import local_folder, write

DEFAULT_SIZE = (256, 256)
"""That of published figures, as in `tinysplat eval`."""

MEANS = ("psnr", "psnr_raw", "psnr_decoded_raw", "ssim", "ssim_raw", "bytes")
"""What of a scene's records goes into the batch's results, averaged over its windows."""


def evaluate(job: BatchJob, threads: int = 1) -> JsonObject:
    """Measure all windows of a scene (its `eval_index.json`, or a Gaussian file) in this process.

    Returns:
        The job's record: `windows`, `means`, and `bytes`, `sha256`, `seconds`, `worker` as for encoding.

    Raises:
        TinySplatError: the scene is at fault, or nothing of it could be measured.
        OSError: storage failed; another attempt may not.
    """
    start = time.perf_counter()
    try:
        import skimage.metrics  # noqa: F401 - what SSIM needs, before work begins

        from tinysplat.measure.quality import ProfileQp, Quality, mean_of, record
        from tinysplat.measure.rows import ROWS, RowFile
        from tinysplat.measure.runner import RunPlan, run_jobs
        from tinysplat.measure.subjects.sources import find_sources
    except ImportError as error:
        install = 'pip install "tinysplat[cluster,eval]" brings it'
        raise InputError(f"needs the package '{error.name}'; {install}", where="--evaluate") from None
    request = job.request
    if isinstance(request.size, str):
        raise InputError(f"'{request.size}', expected WIDTHxHEIGHT to measure at", where="--size")
    with local_folder(job.scene) as folder, tempfile.TemporaryDirectory(prefix="tinysplat-") as results:
        sources, left_out = find_sources([folder], near=request.near, far=request.far)
        plan = RunPlan(sources, (request.model,), request.size or DEFAULT_SIZE)
        coding = ProfileQp(request.planes.name, request.step_qp)
        work, store = Quality((coding,), Path(results)), RowFile(Path(results, ROWS))
        outcome = run_jobs(plan, work, store, threads=threads, runtime=worker_runtime(threads))
    left_out = [*left_out, *outcome.left_out]
    if not outcome.rows:
        raise InputError(str(left_out[0]) if left_out else "no windows to evaluate", where=job.scene)
    records = [{**record(row), "scene": job.name} for row in outcome.rows]
    document = {"scene": job.name, "records": records, "left_out": [str(entry) for entry in left_out]}
    data = (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()
    write(job.output, data)
    return {
        "windows": len(records),
        "means": {name: mean_of([record[name] for record in records]) for name in MEANS},
        "bytes": len(data),
        "sha256": hashlib.sha256(data).hexdigest(),
        "seconds": round(time.perf_counter() - start, 3),
        "worker": os.getpid(),
    }
