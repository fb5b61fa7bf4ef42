"""The public door's arguments to their ends, and what it chooses by itself."""

import os
import subprocess
import sys

import numpy as np
import pytest
from scenes import make_cameras, make_gaussians, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render import DEFINITION, Renderer, render

SCENE, (CAMERA,) = make_gaussians(2, 8, 12), make_cameras(1, 8, 12)


def test_ways_to_draw_are_chosen_by_name() -> None:
    usual = render(SCENE, CAMERA, threads=1)
    np.testing.assert_array_equal(usual, render(SCENE, CAMERA, dilation="own", order="near"))
    by_name = {(d, o): render(SCENE, CAMERA, dilation=d, order=o) for d in ("own", "screen") for o in ("near", "depth")}
    assert len({picture.tobytes() for picture in by_name.values()}) == 4
    np.testing.assert_array_equal(by_name["screen", "depth"], render(SCENE, CAMERA, **DEFINITION))
    for name in ("dilation", "order"):
        with pytest.raises(InputError) as caught:
            Renderer(SCENE, 1, **{name: "none"})
        assert caught.value.where == name


_WITHOUT_NUMBA = """
import sys
sys.modules["numba"] = None
from render.test_renderer import SCENE, Renderer
assert not Renderer(SCENE, 1).is_compiled
Renderer(SCENE, 1, compiled=True)
"""


def test_compiled_code_draws_where_numba_is_and_is_missed_where_it_was_asked_for() -> None:
    pytest.importorskip("numba")
    assert Renderer(SCENE, 1).is_compiled and Renderer(SCENE, 1, compiled=True).is_compiled
    assert not Renderer(SCENE, 1, compiled=False).is_compiled
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", _WITHOUT_NUMBA]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert tells(done.stderr.splitlines()[-1], "InputError tinysplat[fast]")


def test_compiled_code_needs_no_folder_to_be_stored_in() -> None:
    """As in a container that runs as a user without a home."""
    pytest.importorskip("numba")
    environment = {**os.environ, "NUMBA_CACHE_LOCATOR_CLASSES": "ZipCacheLocator"}  # of which our files are none
    command = [sys.executable, "-c", "import importlib; importlib.import_module('tinysplat_runtime.render.compiled')"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
