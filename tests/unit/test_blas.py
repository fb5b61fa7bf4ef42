"""Small linear algebra runs on one BLAS thread, and leaves the number of threads as it found it."""

from __future__ import annotations

import numpy as np

from tinysplat_runtime.system.blas import _thread_count, single_thread


def test_the_number_of_blas_threads_is_one_inside_and_restored_behind():
    functions = _thread_count()
    assert functions is not None, "numpy's wheel carries OpenBLAS"
    get, _ = functions
    before = get()
    with single_thread():
        assert get() == 1
        np.linalg.eigh(np.eye(75))
    assert get() == before
