"""Made scenes are the same numbers whatever instructions a processor has."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import pytest

SCENES = """
import hashlib
from scenes import make_free_gaussians, make_gaussians, make_smooth_gaussians
from tinysplat.measure.subjects.made import cloud, made_gaussians, rolling_surface
import numpy as np
made = [make_gaussians(), make_smooth_gaussians(2, 16, 16, 4), make_free_gaussians(50, 2, np.random.default_rng(1)),
        cloud(200), made_gaussians(2, 16, 16, 2), rolling_surface(2, 8, 8)]
found = hashlib.sha256()
for scene in made:
    for name in ("means", "quats", "scales", "opacities", "sh"):
        found.update(np.ascontiguousarray(getattr(scene, name)).tobytes())
print(found.hexdigest())
"""


@pytest.mark.parametrize(
    "other",
    [{"OPENBLAS_CORETYPE": "PRESCOTT"}, {"OPENBLAS_CORETYPE": "HASWELL", "OPENBLAS_NUM_THREADS": "1"},
     {"NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX2 FMA3"}],
    ids=["old kernel", "other kernel", "without AVX"],
)  # fmt: skip
def test_made_scenes_do_not_hang_on_the_processor(other):
    def digest(**variables: str) -> str:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(["tests", ".", "runtime"]), **variables}
        command = [sys.executable, "-W", "ignore", "-c", SCENES]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    assert digest() == digest(**other) and len(digest()) == 2 * hashlib.sha256().digest_size + 1
