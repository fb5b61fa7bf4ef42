"""`python -m tinysplat_runtime` is the command `tinysplat`: a process that does one thing and ends."""

import atexit
import contextlib
import ctypes
import gc
import os
import sys

_M_MMAP_THRESHOLD, _MOST_KEPT = -3, 4_000_000
"""A number of malloc.h; bytes from which on an array's memory is the system's again once nobody has it."""


def main() -> int:
    """Run the words of the command line in a process of its own; returns the exit status.

    Loading libraries makes a hundred thousand objects that stay. Looking through them for garbage takes 15 ms, so that
    collecting begins when the command does (`cli.run`); taking libraries down at the end takes 40, and leads nowhere.
    numpy's OpenBLAS starts a thread for every core as it loads, each of which spins for 26 ms before it sleeps, then
    and after each job: told 4, the exponent of a count, it sleeps at once. glibc keeps what is freed up to the size of
    the largest array that was, 100 MB of a network's; told a size, it keeps that. A value that the user has set stands.
    """
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")
    if sys.platform == "linux" and "MALLOC_MMAP_THRESHOLD_" not in os.environ:
        with contextlib.suppress(AttributeError):  # of another C library
            ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _MOST_KEPT)
    status: list[int] = []
    atexit.register(_end, status)  # the first to be registered is the last to be called
    gc.disable()
    from .cli import main as run

    status.append(run())
    return status[0]


def _end(status: list[int]) -> None:
    """End the process at once, if the command has come to its end and all that it said is out."""
    with contextlib.suppress(OSError, ValueError):  # a closed pipe, which Python reports better
        sys.stdout.flush()
        sys.stderr.flush()
        if status:
            os._exit(status[0])


if __name__ == "__main__":
    sys.exit(main())
