"""Made scenes are the same numbers from release to release, whatever instructions a processor has."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from fingerprints import print_of

from tinysplat.measure.subjects.made import (
    cloud,
    cloud_camera,
    made_case,
    made_gaussians,
    rolling_surface,
    view_between,
)
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.scene.cameras import Camera

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


ALL = (getattr(np, "_core", None) or np.core)._multiarray_umath.__cpu_dispatch__
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


PRINTS = {
    (made_gaussians, (1, 10, 14, 0)): [
        (2.7468382, 1.8217804), (0.49694838, 0.37499601), (0.29689657, 0.29884417), (0.7619505, 0.76589469),
        (0.61834011, -0.437501),
    ],
    (made_gaussians, (2, 12, 9, 4)): [
        (2.3721749, 1.5903794), (0.49618038, 0.37417763), (0.29576459, 0.29594148), (0.7670609, 0.76594528),
        (0.032783103, -0.010420413),
    ],
    (rolling_surface, (2, 6, 9)): [
        (1.4803317, 1.0004872), (0.42160735, 0.010212827), (0.15779662, 0.16253454), (0.62801831, 0.64333841),
        (0.16947205, -0.0049384211),
    ],
    (rolling_surface, (1, 5, 4, 1)): [
        (1.6399868, 1.0057957), (0.43573397, -0.051447573), (0.3960425, 0.39598823), (0.71315127, 0.71233919),
        (0.34093108, -0.13125176),
    ],
    (cloud, (300,)): [
        (5.5771898, 2.6557396), (0.76100633, -0.070346995), (1.1117989, 1.095665), (0.66915849, 0.67796449),
        (0.76855211, -0.052643228),
    ],
}  # fmt: skip
"""Of means, quaternions, scales, opacities and SH; whoever changes a scene measures anew what was measured on it."""


@pytest.mark.parametrize(("make", "arguments"), PRINTS, ids=lambda value: getattr(value, "__name__", str(value)))
def test_scenes_that_committed_figures_were_measured_on_are_what_they_were(make, arguments) -> None:
    found = make(*arguments)
    for name, wanted in zip(FIELDS, PRINTS[make, arguments], strict=True):
        assert print_of(getattr(found, name)) == pytest.approx(wanted, rel=1e-5, abs=1e-7), name


def test_cameras_of_made_scenes() -> None:
    surface = rolling_surface(3, 6, 10)
    for camera, x in zip(surface.cameras, (-0.2, 0, 0.2), strict=True):
        np.testing.assert_array_equal(camera.c2w, np.eye(4) + x * np.eye(4, k=3))
        np.testing.assert_array_equal(camera.K, [[9, 0, 5], [0, 9, 3], [0, 0, 1]])
    np.testing.assert_allclose(view_between(surface).centre, [-0.1, 0, 0])
    assert view_between(rolling_surface(1, 6, 10)).centre.tolist() == [0, 0, 0]
    camera = cloud_camera(6, 10)
    np.testing.assert_array_equal(camera.K, [[5, 0, 5], [0, 5, 3], [0, 0, 1]])
    assert isinstance(camera, Camera) and (camera.c2w == np.eye(4)).all()
    x, _, z = cloud(3000).means.T
    assert 2 <= z.min() < z.max() <= 12 and np.abs(x / z).max() <= 1.3
    beside = (np.abs(cloud(3000).means[:, :2] / z[:, None]) > 1).any(axis=1).mean()
    assert 0.3 < beside < 0.5


def test_a_made_case_is_named_by_what_it_is_and_judged_between_its_views() -> None:
    case = made_case(2, 10, 12, 1)
    assert case.name == "network-like, room, 2×10×12, SH degree 1"
    assert len(case.cameras) == len(case.photos) == len(case.gaussians.cameras) + 3
