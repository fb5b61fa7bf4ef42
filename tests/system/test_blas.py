"""Linear algebra whose last bits no BLAS decides, and the number of BLAS threads left as it was found."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import write_scene

from tinysplat_runtime.system.blas import single_thread, symmetric_eigen


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e20])
@pytest.mark.parametrize("rank", [1, 2, 4])
@pytest.mark.parametrize("side", [1, 2, 3, 4, 12])
def test_eigenvectors_are_orthonormal_and_diagonalise(side, rank, scale):
    x = np.random.default_rng(side).standard_normal((rank, side)) * np.sqrt(scale)
    matrix = x.T @ x
    values, vectors = symmetric_eigen(matrix)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(side), atol=1e-14)
    np.testing.assert_allclose(vectors * values @ vectors.T, matrix, atol=1e-14 * np.abs(matrix).max())
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), atol=1e-14 * np.abs(matrix).max())


def test_degenerate_matrices_have_eigenvectors_too():
    for matrix in (np.zeros((3, 3)), np.eye(4), np.ones((4, 4)), np.diag([3.0, 1.0, 3.0])):
        values, vectors = symmetric_eigen(matrix)
        assert (np.diff(values) >= 0).all()
        np.testing.assert_allclose(matrix @ vectors, vectors * values, atol=1e-14)


def test_a_block_on_one_thread_gives_back_those_there_were():
    libraries = list((Path(np.__file__).parents[1] / "numpy.libs").glob("*openblas*"))
    if not libraries:
        pytest.skip("numpy without OpenBLAS keeps its threads")
    library = ctypes.CDLL(str(libraries[0]))
    threads, put = library.scipy_openblas_get_num_threads64_, library.scipy_openblas_set_num_threads64_
    usual = threads()
    put(2)
    with pytest.raises(ZeroDivisionError), single_thread():
        assert threads() == 1
        raise ZeroDivisionError
    assert threads() == 2
    put(usual)


ENCODE = """
import sys
from hashlib import sha256
sys.path.insert(0, sys.argv[1])
from scenes import make_smooth_gaussians
import tinysplat_runtime as ts
runtime = ts.Runtime()
flat, shiny = (make_smooth_gaussians(2, 24, 32, degree, layers=2) for degree in (0, 2))
files = [runtime.compress(flat), runtime.compress(shiny, "paper"), runtime.compress(shiny, target_size=6000)]
files.append(runtime.encode(ts.load_scene(sys.argv[2]), mode="photos"))
print(*(sha256(data).hexdigest() for data in files))
"""


def test_bytes_are_the_same_on_any_cores_and_with_any_blas_kernels(tmp_path):
    scene = write_scene(tmp_path / "desk", 2, 48, 64)
    cores = sorted(os.sched_getaffinity(0))
    found = set()
    widest = "SkylakeX" if "avx512f" in Path("/proc/cpuinfo").read_text() else "Sandybridge"
    for kernels, allowed in (("Haswell", cores), ("Prescott", cores[:1]), (widest, cores[:2])):
        command = [sys.executable, "-c", ENCODE, str(Path(__file__).parents[1]), str(scene)]
        blas = {"OPENBLAS_CORETYPE": kernels, "OPENBLAS_NUM_THREADS": str(len(allowed))}
        run = subprocess.run(
            command,
            env={**os.environ, **blas},
            capture_output=True,
            text=True,
            check=True,
            preexec_fn=lambda allowed=allowed: os.sched_setaffinity(0, allowed),
        )
        assert len(run.stdout.split()) == 4
        found.add(run.stdout)
    assert len(found) == 1, "\n".join(found)
