"""Where jobs run: processes of this machine, or a Ray cluster. Both yield results as they come.

A job whose worker dies, or that fails for a reason that may pass, is tried again up to a cap; a scene that is at fault
is not. No more jobs are handed out than workers can have at hand, so that a batch of any length takes bounded memory.
"""

from __future__ import annotations

import logging
import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.system.jsonfields import JsonObject

from ..children import settle_worker, starting_workers
from .jobs import BatchJob

Work = Callable[[BatchJob], JsonObject]

AHEAD = 2
"""Jobs handed out per worker: the next one is there when one ends."""


@dataclass(frozen=True)
class Outcome:
    """What came of a job.

    Attributes:
        job: which.
        record: what its worker returned, or None.
        error: one line, or None.
        attempts: how often it was begun.
    """

    job: BatchJob
    record: JsonObject | None
    error: str | None
    attempts: int


def run_processes(jobs: Sequence[BatchJob], work: Work, workers: int, attempts: int) -> Iterator[Outcome]:
    """Run jobs in `workers` processes.

    A process that dies takes its whole pool along. The jobs that were under way are then run again one at a time, so
    that only the one that kills its worker uses up its attempts.
    """
    queue = deque((job, 1) for job in jobs)
    while queue:
        suspects: list[tuple[BatchJob, int]] = []
        yield from _pool(queue, work, workers, attempts, suspects)
        while suspects:
            job, attempt = suspects.pop(0)
            again: list[tuple[BatchJob, int]] = []
            yield from _pool(deque([(job, attempt + 1)]), work, 1, attempts, again)
            if again and again[0][1] >= attempts:
                yield Outcome(job, None, "its worker died", again[0][1])
            else:
                suspects += again


def _pool(
    queue: deque[tuple[BatchJob, int]], work: Work, workers: int, attempts: int, suspects: list[tuple[BatchJob, int]]
) -> Iterator[Outcome]:
    """Run jobs of `queue` until it is empty or a process dies; the jobs then under way are added to `suspects`."""
    running: dict[Future[JsonObject], tuple[BatchJob, int]] = {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=settle_worker) as pool:
        while (queue or running) and not suspects:
            while queue and len(running) < AHEAD * workers:
                try:
                    with starting_workers():
                        future = pool.submit(work, queue[0][0])
                except BrokenProcessPool:  # one died since the last result
                    if not running:
                        return
                    break
                running[future] = queue.popleft()
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                job, attempt = running.pop(future)
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    suspects.append((job, attempt))
                elif error is not None and _may_pass(error) and attempt < attempts:
                    queue.append((job, attempt + 1))
                else:
                    yield _outcome(job, None if error else future.result(), error, attempt)
    for future, (job, attempt) in running.items():  # the pool is gone: each has ended or been lost with it
        error = future.exception()
        if error is None:
            yield _outcome(job, future.result(), None, attempt)
        else:
            suspects.append((job, attempt))


def run_ray(
    jobs: Sequence[BatchJob], work: Work, workers: int, attempts: int, address: str | None
) -> Iterator[Outcome]:
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


def _ray_tasks(ray: Any, jobs: Sequence[BatchJob], work: Work, attempts: int) -> Iterator[Outcome]:

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
            if error is not None and _may_pass(error) and attempt < attempts:
                queue.append((job, attempt + 1))
            else:
                yield _outcome(job, record, error, attempt)


def _may_pass(error: BaseException) -> bool:
    """Whether another attempt may end otherwise."""
    return not isinstance(error, TinySplatError)


def _outcome(job: BatchJob, record: JsonObject | None, error: BaseException | None, attempt: int) -> Outcome:
    text = None if error is None else " ".join(str(error).split())[:300] or type(error).__name__
    return Outcome(job, record, text, attempt)
