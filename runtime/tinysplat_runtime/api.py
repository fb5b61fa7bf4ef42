"""The chain as functions: photos to Gaussians to bytes, and back to a picture.

A `Runtime` keeps opened graphs from call to call. The functions of the same names use one that lives as long as the
process, with default settings.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, wraps
from inspect import signature
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from .codec.decoder import decode_gaussians
from .codec.modes import AUTO, DEFAULT_MODE
from .codec.modes.registry import MODES
from .codec.profiles import DEFAULT_PROFILE, find_profile
from .container.layout import SUFFIX
from .container.records import Limits
from .errors import InputError, TinySplatError
from .gaussian.gaussians import Gaussians
from .graphs.inference import GraphStore
from .graphs.providers import CPU, Provider
from .system.files import StrPath, read_limited, write_atomically
from .system.stopwatch import Stopwatch
from .system.threads import Crew, available_cores

# Modules that only some calls need are loaded by these: decoding a small file takes less time than loading the encoder.
if TYPE_CHECKING:
    from .codec.encoder import EncodeStats
    from .codec.modes.mode import Job
    from .graphs.enlarge import Enlarger
    from .refine.stats import RefineStats
    from .scene.cameras import Camera
    from .scene.scenes import Scene

DEFAULT_MODEL = "edge"

P = ParamSpec("P")
T = TypeVar("T")

MAX_FILE_BYTES = 1 << 31
"""Largest `.tsplat` file that is read."""

FREE_VIEWS = 4
"""Views about Gaussians of no pixels that `target_psnr` is measured from."""

TARGETS = ("target_size", "target_psnr", "lossless", "like")
"""Options of `compress` that say how planes are coded in place of Q_g."""


class Runtime:
    """Graphs and settings for repeated calls; safe to use from several threads.

    Args:
        threads: planes coded at a time, and threads of synthesis and rasteriser; None for all cores this process may
            use. Never changes a result; networks and analysis use all cores whatever it says (`GraphStore` says why).
        providers: onnxruntime execution providers in order of preference, names or (name, options), built in or of
            plug-in packages (`graphs.providers`).
        models: folder with manifest.json and the artifacts; None for the usual places.
        limits: what a file may ask for when it is decoded.

    Raises:
        InputError: `threads` is below 1.
    """

    def __init__(
        self,
        *,
        threads: int | None = None,
        providers: Sequence[Provider] = (CPU,),
        models: str | os.PathLike[str] | None = None,
        limits: Limits | None = None,
    ) -> None:
        if threads is not None and threads < 1:
            raise InputError(f"{threads}, expected 1 or more", where="threads")
        self.threads = threads or available_cores()
        self.limits = limits or Limits()
        # Decoding runs the synthesis of a view on each thread; threads within would only get in each other's way.
        self.store = GraphStore(threads=1, providers=providers, models=models)

    def predict(
        self, scene: Scene, model: str = DEFAULT_MODEL, *, whole: bool = False, watch: Stopwatch | None = None
    ) -> Gaussians:
        """Gaussians of all views of a scene.

        Large photos (`graphs.enlarge.LARGE_PIXELS`) are scaled down for the shipped networks, and what these find is
        brought to every pixel.

        Args:
            scene: 2 or more views of one size, with near and far; `Scene.views` and `Scene.resized` choose and scale.
            model: a network's name in the manifest, or the path of an .onnx file.
            whole: run the network on the photos as they are, however large: what readers of files with photos do.
            watch: filled with the seconds of stage `network`.

        Returns:
            (V, H, W, …) Gaussians with cameras.

        Raises:
            InputError: too few views, unlike sizes, identical poses, no depth range, an unreadable photo.
            ModelError: no such network, or one that breaks its contract.
            NumericError: the network's output is not finite.
        """
        from .graphs.enlarge import predict_large
        from .graphs.predict import predict as run_network

        watch = watch or Stopwatch()
        near, far = scene.depth_range()
        images = [scene.images()]
        graph = self.store.network(model)
        with watch.stage("network"):
            enlarger = self.enlarger(scene, model, whole=whole)
            if enlarger is not None:
                return predict_large(images.pop(), scene.cameras, near, far, graph, enlarger)
            return run_network(images.pop(), scene.cameras, near, far, graph)

    def enlarger(self, scene: Scene, model: str = DEFAULT_MODEL, *, whole: bool = False) -> Enlarger | None:
        """What brings to all pixels of the scene's photos what the network finds on small copies of them.

        Arguments and errors are those of `predict`; None where it runs the network on the photos as they are.
        """
        from .graphs.enlarge import LARGE_PIXELS, Enlarger

        camera = scene.cameras[0]
        if whole or camera.width * camera.height <= LARGE_PIXELS:
            return None
        graph = self.store.enlarger()
        found = Enlarger.of(graph) if graph is not None else None
        return found if found is not None and self.store.shipped_network(model) in found.networks else None

    def refine(
        self,
        gaussians: Gaussians,
        scene: Scene,
        steps: int | None = None,
        *,
        seconds: float | None = None,
        profile: str = DEFAULT_PROFILE,
        qp: float | None = None,
        stats: RefineStats | None = None,
        show: Callable[..., Iterator[int]] | None = None,
    ) -> Gaussians:
        """Correct Gaussians until they show the photos that they were made of; needs numba (`tinysplat[fast]`).

        Args:
            gaussians: per pixel, with cameras, of two views or more; of any network.
            scene: with the photos, which are found by the poses of their cameras.
            steps: how many to take at most, 20 unless `seconds` are given.
            seconds: for how long at most, in place of `steps`.
            profile, qp: what the result will be coded with, in whose steps its bytes are counted.
            stats: filled with what was done.
            show: see `refine.refine.refine`.

        Returns:
            Gaussians whose notes say how they were refined; the very ones that were given, where no step made photos
            look better from the Gaussians of the other photos.

        Raises:
            InputError: photos that do not fit the Gaussians, steps or seconds out of range, numba is missing.
        """
        try:
            from .refine.refine import refine as run
        except ImportError as error:
            raise InputError(f'needs {error.name}; pip install "tinysplat[fast]" brings it', where="refine") from None
        return run(
            gaussians, scene, steps=steps, seconds=seconds, profile=find_profile(profile), qp=float(qp or 0),
            run_jobs=Crew(self.threads).map, stats=stats, show=show,
        )  # fmt: skip

    def compress(
        self,
        gaussians: Gaussians,
        profile: str = DEFAULT_PROFILE,
        qp: float | None = None,
        *,
        target_size: int | None = None,
        target_psnr: float | None = None,
        lossless: bool = False,
        like: bytes | None = None,
        drop_invalid: bool = False,
        stats: EncodeStats | None = None,
    ) -> bytes:
        """Code Gaussians as a `.tsplat` file's bytes.

        Args:
            gaussians: per pixel, with cameras; or belonging to no pixels, as of a trained or an edited scene, which
                mode `free` codes: as one list, in an order of its own, without those of opacity under 1/255. The file
                carries their notes.
            profile: one of `codec.profiles.PROFILES`.
            qp: Q_g; every quantiser step is multiplied by 2^(qp/6). None is 0, or what a target asks for.
            target_size: bytes of the file in place of `qp`: the largest file found of at most as many.
            target_psnr: dB of decoded against raw renders, the mean over the input views, or over four made up about
                Gaussians of no pixels, in place of `qp`: the smallest file found that has as many.
            lossless: float16 planes, bit for bit (`codec.exact` has the guarantee); profile and qp play no part.
            like: a file's bytes, whose profile, Q_g, maps, steps and QPs are taken, and whose pictures stay where
                nothing changed (`codec.recode`): a decoded scene coded again, edited or not, loses nothing else.
            drop_invalid: make Gaussians at or behind their own camera transparent in place of refusing them.
            stats: filled with what coding measured.

        Raises:
            FormatError: `like` is damaged.
            InputError: an option out of range, two options that contradict each other, a target that cannot be
                reached; with `lossless` or `like`, Gaussians of no pixels, or of other grids than `like`.
            NumericError: Gaussians with z ≤ 0.
        """
        from .codec.encoder import EncodeStats
        from .codec.modes.mode import Job
        from .codec.rate import encode_to_psnr, encode_to_size
        from .codec.recode import encode_like

        check_targets(qp=qp, target_size=target_size, target_psnr=target_psnr, lossless=lossless or None, like=like)
        stats = stats or EncodeStats()
        if like is not None:
            limits, threads = self.limits, self.threads
            return encode_like(
                gaussians, like, self.store, threads=threads, limits=limits, drop_invalid=drop_invalid, stats=stats
            )
        coding = find_profile(DEFAULT_PROFILE if lossless else profile)
        job = Job(gaussians, coding, float(qp or 0), self.store, self.threads, stats, drop_invalid)
        if lossless:
            stats.mode = "lossless"
            return MODES[stats.mode].encode(job)
        if not gaussians.is_per_pixel:
            stats.mode = "free"
            return self._compress_free(job, target_size, target_psnr)
        if target_size is not None:
            return encode_to_size(job.encoder(), target_size)
        if target_psnr is not None:
            return encode_to_psnr(job.encoder(), target_psnr, self._fidelity(gaussians))
        return MODES[DEFAULT_MODE].encode(job)

    def _compress_free(self, job: Job, target_size: int | None, target_psnr: float | None) -> bytes:
        """`compress` of Gaussians that belong to no pixels."""
        from .codec.free.search import code_to_psnr, code_to_size
        from .codec.modes.free import encoder as free_encoder

        if target_size is not None:
            return code_to_size(free_encoder(job), target_size)
        if target_psnr is not None:
            return code_to_psnr(free_encoder(job), target_psnr, self._fidelity(job.gaussians))
        return MODES["free"].encode(job)

    def encode(
        self,
        scene: Scene,
        model: str = DEFAULT_MODEL,
        profile: str = DEFAULT_PROFILE,
        qp: float | None = None,
        *,
        mode: str = DEFAULT_MODE,
        gaussians: Gaussians | None = None,
        stats: EncodeStats | None = None,
        **options: Any,
    ) -> bytes:
        """Photos to a `.tsplat` file's bytes.

        Args:
            scene: see `predict`.
            model: see `predict`.
            profile: see `compress`.
            qp: see `compress`.
            **options: see `compress`.
            mode: what the file carries: gaussians, photos, hybrid or auto (`modes` says what they are).
            gaussians: what `predict` made of the scene, if that is at hand; the file carries their notes.
            stats: filled with what coding measured, the mode, and why `auto` came to it.

        Raises:
            InputError: an unknown mode, one that contradicts a target, and what `predict` and `compress` refuse.
            ModelError, NumericError: as `predict` and `compress`.
        """
        from .codec.encoder import EncodeStats
        from .codec.modes.choice import check_options, choose
        from .codec.modes.mode import Job, PhotoScene

        stats = stats or EncodeStats()
        check_options(mode, has_target=any(options.get(name) for name in TARGETS))
        gaussians = gaussians or self.predict(scene, model, whole=mode != DEFAULT_MODE, watch=stats.watch)
        network_seconds = stats.watch.seconds.get("network", 0.0)
        if mode == DEFAULT_MODE:
            return self.compress(gaussians, profile, qp, stats=stats, **options)
        photos, coding = PhotoScene.of(scene, model, self.store), find_profile(profile)
        job = Job(gaussians, coding, float(qp or 0), self.store, self.threads, stats, photos=photos)
        stats.mode = mode
        if mode != AUTO:
            return MODES[mode].encode(job)
        data = MODES["photos"].encode(job)
        planes = self.compress(gaussians, profile, qp, stats=stats, **options)
        stats.mode, stats.reason = choose(planes, data, photos.network, network_seconds)
        return data if stats.mode == "photos" else planes

    def _fidelity(self, gaussians: Gaussians) -> Callable[[bytes], float]:
        """PSNR of a file's render to that of `gaussians`, the mean over their views or over some made up."""
        from .render import DEFINITION, Renderer
        from .render.paths import ring

        # In numpy, so that no byte depends on whether numba is installed; as defined, so that none follows defaults.
        renderer = Renderer(gaussians, threads=self.threads, compiled=False, **DEFINITION)
        cameras = gaussians.cameras or ring(gaussians, FREE_VIEWS)
        raw = [renderer.render(camera) for camera in cameras]

        def measure(data: bytes) -> float:
            decoded = Renderer(self.decompress(data), threads=self.threads, compiled=False, **DEFINITION)
            errors = [
                float(np.mean((decoded.render(camera).clip(0, 1) - image.clip(0, 1)) ** 2, dtype=np.float64))
                for camera, image in zip(cameras, raw, strict=True)
            ]
            return float(np.mean([-10 * math.log10(max(error, 1e-12)) for error in errors]))

        return measure

    def decompress(
        self,
        data: bytes,
        *,
        max_bytes: int | None = None,
        lost: list[str] | None = None,
        model: str | None = None,
        watch: Stopwatch | None = None,
    ) -> Gaussians:
        """Gaussians of a `.tsplat` file's bytes, cameras with them.

        Args:
            data: the whole file; with `max_bytes`, what there is of it.
            max_bytes: decode from this many first bytes alone: planes behind them are replaced by their stand-ins.
                `inspect` lists useful numbers under `prefixes`.
            lost: give a list to decode what is intact of a damaged or cut file; it is filled with the names of the
                planes that are not.
            model: the network for a file of photos, by path or name; None to find it among the artifacts by its hash.
            watch: filled with seconds per stage.

        Raises:
            FormatError: damaged, cut short, foreign, or beyond the limits; a prefix too short for any picture.
            InputError: `max_bytes` is below 1.
            ModelError: the file carries photos, and the network that it names is not at hand.
        """
        if max_bytes is not None and max_bytes < 1:
            raise InputError(f"{max_bytes}, expected 1 or more", where="max_bytes")
        return decode_gaussians(
            data,
            self.store,
            threads=self.threads,
            limits=self.limits,
            max_bytes=max_bytes,
            lost=lost,
            model=model,
            watch=watch,
        )

    def render(self, gaussians: Gaussians, camera: Camera, size: tuple[int, int] | None = None, **options: Any) -> Any:
        """See `tinysplat_runtime.render.render`, whose options these are."""
        from .render import render as render_gaussians

        return render_gaussians(gaussians, camera, size, **{"threads": self.threads, **options})


def check_targets(**options: Any) -> None:
    """InputError where options of `compress` contradict each other or lie out of range."""
    given = [name for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"given with {given[0]}, which contradicts it; expected one of them", where=given[1])
    size, psnr = options["target_size"], options["target_psnr"]
    if size is not None and size < 1:
        raise InputError(f"{size} bytes, expected 1 or more", where="target_size")
    if psnr is not None and not 0 < psnr < 120:
        raise InputError(f"{psnr:g} dB, expected more than 0 and less than 120", where="target_psnr")


@lru_cache(maxsize=1)
def _shared() -> Runtime:
    return Runtime()


def _door(method: Callable[Concatenate[Runtime, P], T]) -> Callable[P, T]:
    """A method as a function, on the runtime that lives as long as the process; arguments and help are the method's."""

    @wraps(method)
    def call(*args: P.args, **options: P.kwargs) -> T:
        return method(_shared(), *args, **options)

    parameters = list(signature(method).parameters.values())[1:]
    call.__signature__ = signature(method).replace(parameters=parameters)  # type: ignore[attr-defined]
    return call


predict = _door(Runtime.predict)
refine = _door(Runtime.refine)
compress = _door(Runtime.compress)
encode = _door(Runtime.encode)
decompress = _door(Runtime.decompress)
render = _door(Runtime.render)


def load_gaussians(path: StrPath, *arguments: Any, **options: Any) -> Gaussians:
    """Read a `.tsplat` file, or a Gaussian file of another format as `formats.table.load_gaussians` does.

    Raises:
        FormatError: a damaged `.tsplat` file.
        InputError: names the file: missing, damaged, or options that a `.tsplat` file, which has cameras, cannot take.
    """
    if not os.fspath(path).lower().endswith(SUFFIX):
        from .formats import table

        return table.load_gaussians(path, *arguments, **options)
    if arguments or options:
        raise InputError("a .tsplat file has a grid and cameras of its own; expected none", where=str(path))
    try:
        return decompress(read_limited(path, MAX_FILE_BYTES))
    except TinySplatError as error:
        raise error.within(str(path)) from None


def save_gaussians(path: StrPath, gaussians: Gaussians, *arguments: Any, **options: Any) -> list[str]:
    """Write a `.tsplat` file with the default profile, or another format as `formats.table.save_gaussians` does.

    Returns:
        What the format could not keep, one line each.

    Raises:
        InputError, NumericError: as `compress`, or as `formats.table.save_gaussians`.
    """
    if not os.fspath(path).lower().endswith(SUFFIX):
        from .formats import table

        return table.save_gaussians(path, gaussians, *arguments, **options)
    write_atomically(path, compress(gaussians, *arguments, **options))
    return []


def inspect(data: bytes) -> dict[str, Any]:
    """What a file holds, without decoding planes; see `tinysplat_runtime.container.inspection.inspect_bytes`."""
    from .container.inspection import inspect_bytes

    return inspect_bytes(data)
