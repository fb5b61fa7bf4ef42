"""How long one scene of a batch may take, and how much memory."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.jsonfields import JsonObject

from .jobs import BatchJob


def bounded(
    job: BatchJob, work: Callable[[BatchJob], JsonObject], timeout: float | None, memory: int | None
) -> JsonObject:
    """Run a job within bounds; another attempt would end the same way.

    Args:
        job: which.
        work: what is done with it.
        timeout: seconds, noticed between calls into libraries; None for any number.
        memory: bytes that the worker's process may have of its own, where the system keeps such a limit; None for any.

    Raises:
        InputError: a bound was reached.
    """
    with _memory(memory), _alarm(timeout):
        try:
            return work(job)
        except MemoryError:
            raise InputError(f"needs more memory than the {memory} bytes of --max-memory") from None


@contextlib.contextmanager
def _alarm(seconds: float | None) -> Iterator[None]:
    if seconds is None or not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(number: int, frame: object) -> None:
        raise InputError(f"took longer than the {seconds:g} s of --timeout")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _memory(limit: int | None) -> Iterator[None]:
    try:
        import resource
    except ImportError:  # not Unix
        limit = None
    if limit is None:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (limit if hard < 0 else min(limit, hard), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
