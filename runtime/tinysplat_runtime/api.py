"""The chain as functions: photos to Gaussians to bytes, and back to a picture.

A `Runtime` keeps opened graphs from call to call. The functions of the same names use one that lives as long as the
process, with default settings.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from numpy.typing import NDArray

from .cameras import Camera
from .codec.decoder import decode_gaussians
from .codec.encoder import EncodeStats, encode_gaussians
from .codec.profiles import DEFAULT_PROFILE, find_profile
from .container.layout import Limits
from .errors import InputError
from .gaussians import Gaussians
from .inference import GraphStore
from .inspection import inspect_bytes
from .predict import predict as run_network
from .render import render as render_gaussians
from .reports import Stopwatch
from .scenes import Scene
from .threads import available_cores

DEFAULT_MODEL = "sweep"


class Runtime:
    """Graphs and settings for repeated calls; safe to use from several threads.

    Args:
        threads: planes coded at a time, and threads of synthesis and rasteriser; None for all cores this process may
            use. Never changes a result; networks and analysis use all cores whatever it says (`GraphStore` says why).
        providers: onnxruntime execution providers in order of preference.
        models: folder with manifest.json and the artifacts; None for the usual places.
        limits: what a file may ask for when it is decoded.

    Raises:
        InputError: `threads` is below 1.
    """

    def __init__(
        self,
        *,
        threads: int | None = None,
        providers: Sequence[str] = ("CPUExecutionProvider",),
        models: str | os.PathLike[str] | None = None,
        limits: Limits | None = None,
    ) -> None:
        if threads is not None and threads < 1:
            raise InputError(f"{threads}, expected 1 or more", where="threads")
        self.threads = threads or available_cores()
        self.limits = limits or Limits()
        self.store = GraphStore(threads=self.threads, providers=providers, models=models)

    def predict(self, scene: Scene, model: str = DEFAULT_MODEL, *, watch: Stopwatch | None = None) -> Gaussians:
        """Gaussians of all views of a scene.

        Args:
            scene: 2 or more views of one size, with near and far; `Scene.views` and `Scene.resized` choose and scale.
            model: a network's name in the manifest, or the path of an .onnx file.
            watch: filled with the seconds of stage `network`.

        Returns:
            (V, H, W, …) Gaussians with cameras.

        Raises:
            InputError: too few views, unlike sizes, identical poses, no depth range, an unreadable photo.
            ModelError: no such network, or one that breaks its contract.
            NumericError: the network's output is not finite.
        """
        watch = watch or Stopwatch()
        near, far = scene.depth_range()
        images = scene.images()
        graph = self.store.network(model)
        with watch.stage("network"):
            return run_network(images, scene.cameras, near, far, graph)

    def compress(
        self,
        gaussians: Gaussians,
        profile: str = DEFAULT_PROFILE,
        qp: float = 0,
        *,
        drop_invalid: bool = False,
        stats: EncodeStats | None = None,
    ) -> bytes:
        """Code Gaussians as a `.tsplat` file's bytes.

        Args:
            gaussians: per pixel, with cameras.
            profile: paper, fast, balanced or max.
            qp: Q_g; every quantiser step is multiplied by 2^(qp/6).
            drop_invalid: make Gaussians at or behind their own camera transparent in place of refusing them.
            stats: filled with what coding measured.

        Raises:
            InputError: an option out of range, or Gaussians of no pixels.
            NumericError: Gaussians with z ≤ 0.
        """
        return encode_gaussians(
            gaussians, find_profile(profile), float(qp), self.store, threads=self.threads, drop_invalid=drop_invalid,
            stats=stats,
        )  # fmt: skip

    def decompress(self, data: bytes, *, max_bytes: int | None = None, watch: Stopwatch | None = None) -> Gaussians:
        """Gaussians of a `.tsplat` file's bytes, cameras with them.

        Args:
            data: the whole file; with `max_bytes`, what there is of it.
            max_bytes: decode from this many first bytes alone: planes behind them are replaced by their stand-ins.
                `inspect` lists useful numbers under `prefixes`.
            watch: filled with seconds per stage.

        Raises:
            FormatError: damaged, cut short, foreign, or beyond the limits; a prefix too short for any picture.
            InputError: `max_bytes` is below 1.
        """
        if max_bytes is not None and max_bytes < 1:
            raise InputError(f"{max_bytes}, expected 1 or more", where="max_bytes")
        return decode_gaussians(
            data, self.store, threads=self.threads, limits=self.limits, max_bytes=max_bytes, watch=watch
        )

    def render(self, gaussians: Gaussians, camera: Camera, size: tuple[int, int] | None = None, **options: Any) -> Any:
        """See `tinysplat_runtime.render.render`, whose options these are."""
        return render_gaussians(gaussians, camera, size, **{"threads": self.threads, **options})


@lru_cache(maxsize=1)
def _shared() -> Runtime:
    return Runtime()


def predict(scene: Scene, model: str = DEFAULT_MODEL) -> Gaussians:
    """Gaussians of all views of a scene; see `Runtime.predict`."""
    return _shared().predict(scene, model)


def compress(
    gaussians: Gaussians, profile: str = DEFAULT_PROFILE, qp: float = 0, *, drop_invalid: bool = False
) -> bytes:
    """A `.tsplat` file's bytes; see `Runtime.compress`."""
    return _shared().compress(gaussians, profile, qp, drop_invalid=drop_invalid)


def decompress(data: bytes, *, max_bytes: int | None = None) -> Gaussians:
    """Gaussians of a file's bytes; see `Runtime.decompress`."""
    return _shared().decompress(data, max_bytes=max_bytes)


def render(
    gaussians: Gaussians, camera: Camera, size: tuple[int, int] | None = None, **options: Any
) -> NDArray | dict[str, NDArray]:
    """A picture; see `tinysplat_runtime.render.render`."""
    return _shared().render(gaussians, camera, size, **options)


def inspect(data: bytes) -> dict[str, Any]:
    """What a file holds, without decoding planes; see `tinysplat_runtime.inspection.inspect_bytes`."""
    return inspect_bytes(data)
