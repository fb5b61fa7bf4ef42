"""Kernels compiled before somebody waits for them: made scenes go through all that is compiled."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ..api import Runtime
from ..errors import InputError, fast_for
from ..gaussian.gaussians import Gaussians
from ..network.predict import predict
from ..render import Renderer
from ..scene.intake.cameras_json import write_photos
from ..system.told import Told
from .trial import made_photos

PHOTOS = 8
"""Enough for a list."""


def warm(told: Told) -> str:
    """Compile all kernels that no earlier run left; the folder that they are in, or beside.

    Raises:
        InputError: numba is not installed, or has no place to keep what it compiles.
    """
    with fast_for("--warm"):
        from ..system.kernels_compile import KEPT_IN
    if not KEPT_IN:
        raise InputError("no folder to keep it in can be written to; NUMBA_CACHE_DIR names one", where="--warm")
    runtime = Runtime(threads=1)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _, work in told.progress("compiling kernels", _works(runtime, Path(folder))):
            work()
    return KEPT_IN


def _works(runtime: Runtime, folder: Path) -> list[tuple[str, Callable[[], object]]]:
    """What leads through kernels, by their rooms."""
    photos, cameras, near, far = made_photos(PHOTOS)
    write_photos(folder, photos, cameras, (near, far))

    def capture() -> Gaussians:
        return predict(photos[:2], cameras[:2], near, far, runtime.store.network("edge"))

    def draw() -> None:
        for gaussians in (capture(), capture().flat()):
            Renderer(gaussians, 1).render(cameras[0], outputs=("rgb", "depth"))

    def prune() -> None:
        runtime.compress(replace(capture().flat(), viewpoints=cameras))

    return [
        ("drawing", draw),
        ("depth and training", lambda: runtime.encode(folder, views="all", train=2)),
        ("lists", prune),
    ]
