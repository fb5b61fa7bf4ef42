"""Linear algebra that a file's bytes may hang on: the same to the last bit whichever BLAS numpy was built with.

BLAS sums in an order that depends on its kernels, which it picks by processor, and on its threads. What stays in
float32 therefore goes through numpy's own loops (`product`), and eigenvectors of up to 4 × 4 through rotations of our
own (`symmetric_eigen`). Larger ones are LAPACK's, on one thread: OpenBLAS runs even a 75 × 75 eigen-decomposition on
all cores, and a busy core makes it wait for a time slice, 10 to 50 ms where the work is 0.4. Their float64 is rounded
to float16 or float32 before anything follows from it. Builds of numpy without OpenBLAS keep their threads.
"""

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_OWN_SIDE = 4
"""Largest matrix that is decomposed by Jacobi's rotations: in Python, each costs microseconds."""

_SWEEPS = 30
"""More than enough: the rotations converge quadratically, in about six."""

_lock = threading.Lock()


@lru_cache(maxsize=1)
def _thread_count() -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """OpenBLAS's getter and setter of its number of threads, if it is the one in numpy's wheel."""
    for path in sorted((Path(np.__file__).parents[1] / "numpy.libs").glob("*openblas*")):
        library = ctypes.CDLL(str(path))
        for name in ("scipy_openblas_{}_num_threads64_", "openblas_{}_num_threads64_"):
            if hasattr(library, name.format("set")):
                return getattr(library, name.format("get")), getattr(library, name.format("set"))
    return None


@contextmanager
def single_thread() -> Iterator[None]:
    """Run the block's linear algebra on one thread."""
    functions = _thread_count()
    if functions is None:
        yield
        return
    get, put = functions
    with _lock:
        before = get()
        put(1)
        try:
            yield
        finally:
            put(before)


def product(a: NDArray, b: NDArray) -> NDArray:
    """a @ b of (…, n, k) and (…, k, m) float, summed in the order of k whatever BLAS there is."""
    return np.einsum("...nk,...km->...nm", a, b)


def symmetric_eigen(matrices: NDArray) -> tuple[NDArray, NDArray]:
    """Eigenvalues (…, n) rising and eigenvectors (…, n, n), in columns, of symmetric float64 matrices (…, n, n).

    Up to 4 × 4 by cyclic Jacobi rotations (Golub and Van Loan, Matrix Computations, section 8.5); beyond by LAPACK.
    """
    side = matrices.shape[-1]
    if side > _OWN_SIDE or not np.isfinite(matrices).all():
        with single_thread():
            values, vectors = np.linalg.eigh(matrices)
        return values, vectors
    rows, vectors = matrices.astype(np.float64), np.broadcast_to(np.eye(side), matrices.shape).copy()
    pairs = [(p, q) for p in range(side - 1) for q in range(p + 1, side)]
    for _ in range(_SWEEPS):
        if not any(rows[..., p, q].any() for p, q in pairs):
            break
        for p, q in pairs:
            _rotate(rows, vectors, p, q)
    values = np.diagonal(rows, axis1=-2, axis2=-1)
    order = np.argsort(values, axis=-1, kind="stable")
    return np.take_along_axis(values, order, -1), np.take_along_axis(vectors, order[..., None, :], -1)


def _rotate(rows: NDArray, vectors: NDArray, p: int, q: int) -> None:
    """One Jacobi rotation of every matrix, in place: entries (p, q) become 0."""
    here, there, beside = rows[..., p, p], rows[..., q, q], rows[..., p, q]
    is_small = np.abs(beside) <= 1e-17 * np.sqrt(np.abs(here * there))
    slope = (there - here) / (2 * np.where(is_small, 1, beside))
    tangent = np.copysign(1, slope) / (np.abs(slope) + np.sqrt(slope * slope + 1))
    tangent = np.where(is_small, 0, tangent)[..., None]
    cosine = 1 / np.sqrt(tangent * tangent + 1)
    sine = tangent * cosine
    for array in (rows, rows.swapaxes(-1, -2), vectors):  # columns, rows, and columns of what is turned with them
        one, other = array[..., p].copy(), array[..., q]
        array[..., p], array[..., q] = cosine * one - sine * other, sine * one + cosine * other
    rows[..., p, q] = rows[..., q, p] = 0.0
