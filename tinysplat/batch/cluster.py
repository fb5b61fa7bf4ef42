"""A batch as tasks of a Ray cluster (extra `cluster`), results as they come; attempts as `workers` has them."""

import logging
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.jsonfields import JsonObject

from ..workers import AHEAD, Outcome, Work, may_pass, outcome_of
from .jobs import BatchJob


def run_ray(
    jobs: Sequence[BatchJob], work: Work[BatchJob, JsonObject], workers: int, attempts: int, address: str | None
) -> Iterator[Outcome[BatchJob, JsonObject]]:
    """Run jobs as Ray tasks on the cluster at `address`, or on one started here with `workers` CPUs.

    Raises:
        InputError: ray is not installed, or there is no cluster at the address.
    """
    try:
        import ray
    except ImportError:
        raise InputError('needs ray; pip install "tinysplat[cluster]" brings it', where="--engine ray") from None
    ours = not ray.is_initialized()
    if ours:
        start = {"address": address} if address else {"num_cpus": workers, "include_dashboard": False}
        try:
            ray.init(log_to_driver=False, logging_level=logging.ERROR, **start)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise InputError(f"no Ray cluster there ({str(error).splitlines()[0][:120]})", where=str(address)) from None
    try:
        yield from _ray_tasks(ray, jobs, work, attempts)
    finally:
        if ours:
            ray.shutdown()


def _ray_tasks(
    ray: Any, jobs: Sequence[BatchJob], work: Work[BatchJob, JsonObject], attempts: int
) -> Iterator[Outcome[BatchJob, JsonObject]]:
    def begin(job: BatchJob) -> JsonObject:
        return work(job)

    task = ray.remote(num_cpus=1, max_retries=0)(begin)  # attempts are counted here, whatever ended them
    limit = AHEAD * max(int(ray.cluster_resources().get("CPU", 1)), 1)
    queue = deque((job, 1) for job in jobs)
    running: dict[Any, tuple[BatchJob, int]] = {}
    while queue or running:
        while queue and len(running) < limit:
            job, attempt = queue.popleft()
            running[task.remote(job)] = (job, attempt)
        done, _ = ray.wait(list(running), num_returns=1)
        for reference in done:
            job, attempt = running.pop(reference)
            record, error = None, None
            try:
                record = ray.get(reference)
            except ray.exceptions.RayTaskError as failed:
                error = failed.cause
            except ray.exceptions.RayError as failed:
                error = failed
            if error is not None and may_pass(error) and attempt < attempts:
                queue.append((job, attempt + 1))
            else:
                yield outcome_of(job, record, error, attempt)
