"""Made scenes are the same numbers from release to release, whatever instructions a processor has."""

from __future__ import annotations

import hashlib
import importlib
import os
import subprocess
import sys

import numpy as np

SCENES = """
import hashlib
from scenes import make_free_gaussians, make_gaussians, make_smooth_gaussians
from tinysplat.measure.subjects.made import cloud, made_gaussians
import numpy as np
made = [make_gaussians(), make_smooth_gaussians(2, 16, 16, 4), make_free_gaussians(50, 2, np.random.default_rng(1)),
        cloud(200), made_gaussians(2, 16, 16, 2)]
found = hashlib.sha256()
for scene in made:
    for name in ("means", "quats", "scales", "opacities", "sh"):
        found.update(np.ascontiguousarray(getattr(scene, name)).tobytes())
print(found.hexdigest())
"""


CORE = "numpy._core" if hasattr(np, "_core") else "numpy.core"
ALL = importlib.import_module(f"{CORE}._multiarray_umath").__cpu_dispatch__
"""What this numpy chooses between, whose names differ with its version: AVX2, or X86_V3."""


def test_made_scenes_do_not_hang_on_the_processor():
    def digest(**variables: str) -> str:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(["tests", ".", "runtime"]), **variables}
        command = [sys.executable, "-W", "ignore", "-c", SCENES]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    here = digest(NPY_DISABLE_CPU_FEATURES="")
    assert len(here) == 2 * hashlib.sha256().digest_size + 1
    assert digest(OPENBLAS_CORETYPE="PRESCOTT", NPY_DISABLE_CPU_FEATURES=" ".join(ALL)) == here
    assert digest(OPENBLAS_CORETYPE="HASWELL", OPENBLAS_NUM_THREADS="1", NPY_DISABLE_CPU_FEATURES="") == here
