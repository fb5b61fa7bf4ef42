"""Work done by processes of this machine, results as they come; many scenes of a batch, many windows of an evaluation.

A job whose process dies, or that fails for a reason that may pass, is tried again up to a cap; what is at fault itself
is not. No more jobs are handed out than processes can have at hand, so that any number of them takes bounded memory.

Processes end when they should: with the one that started them, and at once when interrupted. A pool's worker waits on a
queue whose writing end its siblings hold open as well: when the parent is killed, it would wait for ever; and an
interrupt, which a terminal sends to all, would end it with a traceback. Files are never torn by either, since they are
renamed into place.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

from tinysplat_runtime.errors import TinySplatError

Job = TypeVar("Job")
Record = TypeVar("Record")

Work = Callable[[Job], Record]

AHEAD = 2
"""Jobs handed out per process: the next one is there when one ends."""


@dataclass(frozen=True)
class Outcome(Generic[Job, Record]):
    """What came of a job.

    Attributes:
        job: which.
        record: what its work returned, or None.
        error: one line, or None.
        attempts: how often it was begun.
    """

    job: Job
    record: Record | None
    error: str | None
    attempts: int


def run_here(jobs: Iterable[Job], work: Work[Job, Record]) -> Iterator[Outcome[Job, Record]]:
    """Run jobs in this process, one after the other; an error that no job is to blame for ends it."""
    for job in jobs:
        try:
            found: Outcome[Job, Record] = Outcome(job, work(job), None, 1)
        except TinySplatError as error:
            found = outcome_of(job, None, error, 1)
        yield found


def run_processes(
    jobs: Sequence[Job], work: Work[Job, Record], workers: int, attempts: int
) -> Iterator[Outcome[Job, Record]]:
    """Run jobs in `workers` processes.

    A process that dies takes its whole pool along. The jobs that were under way are then run again one at a time, so
    that only the one that kills its worker uses up its attempts.
    """
    queue = deque((job, 1) for job in jobs)
    while queue:
        suspects: list[tuple[Job, int]] = []
        yield from _pool(queue, work, workers, attempts, suspects)
        while suspects:
            job, attempt = suspects.pop(0)
            again: list[tuple[Job, int]] = []
            yield from _pool(deque([(job, attempt + 1)]), work, 1, attempts, again)
            if again and again[0][1] >= attempts:
                yield Outcome(job, None, "its worker died", again[0][1])
            else:
                suspects += again


def _pool(
    queue: deque[tuple[Job, int]], work: Work[Job, Record], workers: int, attempts: int, suspects: list[tuple[Job, int]]
) -> Iterator[Outcome[Job, Record]]:
    """Run jobs of `queue` until it is empty or a process dies; the jobs then under way are added to `suspects`."""
    running: dict[Future[Record], tuple[Job, int]] = {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=_settle) as pool:
        while (queue or running) and not suspects:
            while queue and len(running) < AHEAD * workers:
                try:
                    with _starting_workers():
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
                elif error is not None and may_pass(error) and attempt < attempts:
                    queue.append((job, attempt + 1))
                else:
                    yield outcome_of(job, None if error else future.result(), error, attempt)
    for future, (job, attempt) in running.items():  # the pool is gone: each has ended or been lost with it
        error = future.exception()
        if error is None:
            yield outcome_of(job, future.result(), None, attempt)
        else:
            suspects.append((job, attempt))


def may_pass(error: BaseException) -> bool:
    """Whether another attempt may end otherwise."""
    return not isinstance(error, TinySplatError)


def outcome_of(job: Job, record: Record | None, error: BaseException | None, attempt: int) -> Outcome[Job, Record]:
    """How a job ended, an error in a line."""
    text = None if error is None else " ".join(str(error).split())[:300] or type(error).__name__
    return Outcome(job, record, text, attempt)


@contextmanager
def _starting_workers() -> Iterator[None]:
    """Processes that the block starts, as a pool does when it is first given work, see no interrupt before they are
    settled; one that comes meanwhile is kept for all. Windows has no such mask: a traceback more there, at worst.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    came: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    # The mask is what workers inherit; a library's thread may still take the signal here, which Python then raises.
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if is_main else None
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if is_main:
            signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def _settle() -> None:
    """Call in a worker that was started so, first of all."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
