"""What `doctor` runs made scenes through: all kernels, before somebody waits for them to be compiled, and every graph,
to see which execution provider really runs it.
"""

import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..api import Runtime
from ..errors import InputError, TinySplatError, fast_for
from ..gaussian.gaussians import Gaussians
from ..graphs import DEFAULT_MODEL
from ..graphs.inference import GraphStore
from ..graphs.providers import Provider
from ..network.predict import predict
from ..render import Renderer
from ..scene.cameras import Camera
from ..scene.intake.cameras_json import write_photos
from ..system.told import Told

SIDE = 64
"""Pixels of the made photos' sides."""


def ran_by(providers: Sequence[Provider], wrong: list[str]) -> dict[str, dict[str, int]]:
    """How often each provider ran a node, by graph, on two photos coded and decoded.

    Args:
        providers: as `Runtime` takes them.
        wrong: gets a line where a graph cannot be run; what ran before it is told all the same.
    """
    with tempfile.TemporaryDirectory() as folder:
        runtime = Runtime(threads=1, providers=providers)
        runtime.store = GraphStore(threads=1, providers=providers, profile=folder)
        try:
            gaussians = predict(*made_photos(2), runtime.store.network(DEFAULT_MODEL))
            sh = np.tile(gaussians.sh, (4, 1))  # of degree 1, as one colour each needs no analysis of its own
            gaussians = replace(gaussians, sh=sh, extra_layers=())
            runtime.decompress(runtime.compress(gaussians, "paper"))
        except TinySplatError as error:
            wrong.append(str(error))
        return runtime.store.nodes_by_provider()


def made_photos(count: int) -> tuple[NDArray, tuple[Camera, ...], float, float]:
    """(count, SIDE, SIDE, 3) float32 of a textured plane at z = 3, its cameras, near and far."""
    K = np.array([[SIDE, 0, SIDE / 2], [0, SIDE, SIDE / 2], [0, 0, 1]])
    y, x = np.mgrid[:SIDE, :SIDE] * (3 / SIDE)
    images, cameras = [], []
    for offset in np.linspace(-0.1, 0.1, count):
        c2w = np.eye(4)
        c2w[0, 3] = offset
        cameras.append(Camera(K, c2w, SIDE, SIDE))
        waves = [np.sin((20 + c) * (x + offset)) * np.cos((15 + c) * y) for c in range(3)]
        images.append(0.5 + 0.4 * np.stack(waves, axis=-1))
    return np.array(images, np.float32), tuple(cameras), 2.0, 6.0


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
