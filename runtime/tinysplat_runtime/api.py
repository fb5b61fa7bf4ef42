"""The chain as functions: photos to Gaussians to bytes, and back to a picture.

A `Runtime` keeps opened graphs from call to call. The functions of the same names use one that lives as long as the
process, with default settings.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import lru_cache, wraps
from inspect import signature
from numbers import Integral
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from .container.layout import MAX_FILE_BYTES, SUFFIX
from .container.limits import Limits
from .errors import InputError, check_is, within
from .gaussian.gaussians import Gaussians
from .graphs import DEFAULT_MODEL
from .graphs.inference import GraphStore
from .graphs.providers import CPU, Provider
from .system.files import StrPath, read_limited
from .system.jsonfields import JsonObject
from .system.stopwatch import Stopwatch
from .system.threads import available_cores
from .system.told import Told, Warned

# Modules that only some calls need are loaded by these: decoding a small file takes less time than loading the encoder.
if TYPE_CHECKING:
    from typing import Unpack

    from .codec.job import EncodeStats
    from .recipe.request import CompressKeywords, EncodeKeywords, ExportKeywords, SaveKeywords
    from .render.renderer import PictureOptions
    from .scene.cameras import Camera
    from .scene.scenes import Scene

PATH = str | os.PathLike
GAUSSIANS = "gaussians", "Gaussians, of `predict` or `load_gaussians`"
BYTES = "data", "bytes of a .tsplat file; `load_gaussians` reads one by its path"
"""Arguments of which another kind is given now and then, and what is expected."""

P = ParamSpec("P")
T = TypeVar("T")


class Runtime:
    """Graphs and settings for repeated calls; safe to use from several threads.

    Args:
        threads: planes coded at a time, and threads of synthesis and rasteriser; None for all cores this process may
            use. Never changes a result; networks and analysis use all cores whatever it says (`GraphStore` says why).
        providers: onnxruntime execution providers in order of preference, names or (name, options), built in or of
            plug-in packages (`graphs.providers`).
        models: folder with manifest.json and the artifacts; None for the usual places.
        limits: what a file may ask for when it is decoded.
        told: who is told what long work does, such as `ts.Voice()`, which says on standard error how far it is and
            about how many seconds are left; None for doubts alone, which are a `SceneWarning` each.

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
        told: Told | None = None,
    ) -> None:
        if threads is not None and (not isinstance(threads, Integral) or threads < 1):
            raise InputError(f"{threads}, expected a whole number of 1 or more", where="threads")
        self.threads = threads or available_cores()
        self.limits, self.told = limits or Limits(), told or Warned()
        # Decoding runs the synthesis of a view on each thread; threads within would only get in each other's way.
        self.store = GraphStore(threads=1, providers=providers, models=models)

    def predict(
        self,
        scene: Scene,
        model: str = DEFAULT_MODEL,
        *,
        whole: bool = False,
        joint: bool = True,
        watch: Stopwatch | None = None,
    ) -> Gaussians:
        """Gaussians of all views of a scene.

        Three photos or more are grouped with their neighbours (`scene.neighbours`) and go through the network's stages
        one by one (`network.each`), between which all agree on depth (`network.joint`); where it has none, more than it
        takes at once go group by group. Large photos (`network.enlarge.LARGE_PIXELS`) are scaled down for the shipped
        networks, and what these find is brought to every pixel.

        Args:
            scene: 2 or more views of one size, with near and far; `Scene.views` and `Scene.resized` choose and scale.
            model: a network's name in the manifest, or the path of an .onnx file.
            whole: run the network on the photos as they are, however large: what readers of files with photos do.
            joint: let all photos agree on depth, which needs numba.
            watch: filled with the seconds of stage `network`.

        Returns:
            (V, H, W, …) Gaussians with cameras.

        Raises:
            InputError: too few views, unlike sizes, identical poses, no depth range, an unreadable photo, or one that
                matches none of many.
            ModelError: no such network, or one that breaks its contract.
            NumericError: the network's output is not finite.
        """
        from .network.ways import Way
        from .scene.scenes import Scene

        check_is(scene, Scene, "scene", "a Scene, which `load_scene` reads")
        way = Way.of(scene, model, self.store, threads=self.threads, whole=whole, joint=joint)
        return way.predicted(scene, watch or Stopwatch(), self.told)

    def compress(
        self,
        gaussians: Gaussians,
        profile: str | None = None,
        qp: float | None = None,
        *,
        stats: EncodeStats | None = None,
        **options: Unpack[CompressKeywords],
    ) -> bytes:
        """Code Gaussians as a `.tsplat` file's bytes: those that `tinysplat compress` writes of the same options.

        Args:
            gaussians: per pixel, with cameras; or a list, as of a trained or an edited scene, which is coded in an
                order of its own, without those that pictures hardly need (`keep_all` keeps them; so does a Python
                without numba, with a warning) and those of opacity under 1/255. The file carries their notes and
                viewpoints. Without `cameras`, what is surely an object is looked at from outside, and of anything else
                all is kept, with a warning.
            profile, qp: see `recipe.request.Coding`.
            stats: filled with what coding measured.
            **options: of `recipe.request.CompressRequest`.

        Raises:
            FormatError: `like` is damaged.
            InputError: an option of a wrong kind or out of range, two options that contradict each other, a target that
                cannot be reached; with `lossless` or `like`, a list, or of other grids than `like`.
            NumericError: Gaussians with z ≤ 0.
        """
        from .recipe.compress import compress
        from .recipe.request import CompressRequest

        check_is(gaussians, Gaussians, *GAUSSIANS)
        request = CompressRequest.of(gaussians, profile=profile, qp=qp, **options)
        return compress(request, self, self.told, stats=stats).data

    def encode(
        self,
        scene: Scene | StrPath | Sequence[StrPath],
        model: str = DEFAULT_MODEL,
        profile: str | None = None,
        qp: float | None = None,
        *,
        gaussians: Gaussians | None = None,
        stats: EncodeStats | None = None,
        **options: Unpack[EncodeKeywords],
    ) -> bytes:
        """Photos to a `.tsplat` file's bytes: the very bytes that `tinysplat encode` writes of the same options.

        Of more than six photos those that the scene needs are chosen. Three or more become one trained list where numba
        is installed, or with `fast` planes of what the network made of them. A depth range that the scene lacks is
        estimated, photos of more than about 640×480 pixels are scaled to that, and what is likely wrong with the scene
        is a `SceneWarning`.

        Args:
            scene: a `Scene`, the path of one, or what else `recipe.request.EncodeRequest` takes.
            model: see `predict`.
            profile, qp: see `compress`.
            gaussians: what `predict` made of the scene, if that is at hand: nothing is then chosen, found, scaled or
                looked at, and the file carries their notes.
            stats: filled with what coding measured, and the mode.
            **options: of `recipe.request.EncodeRequest`, by the names of the command's.

        Raises:
            InputError: an option of a wrong kind or out of range, two options that contradict each other, a scene that
                memory does not suffice for, and what `predict` and `compress` refuse.
            ModelError, NumericError: as `predict` and `compress`.
        """
        from .recipe.encode import encode, encode_predicted
        from .recipe.request import EncodeRequest

        request = EncodeRequest.of(scene, model=model, profile=profile, qp=qp, **options)
        if gaussians is not None:
            return encode_predicted(request, gaussians, self, stats=stats)
        return encode(request, self, self.told, stats=stats).data

    def decompress(
        self,
        data: bytes,
        *,
        max_bytes: int | None = None,
        views: Sequence[int] | None = None,
        lost: list[str] | None = None,
        model: str | None = None,
        watch: Stopwatch | None = None,
    ) -> Gaussians:
        """Gaussians of a `.tsplat` file's bytes, cameras with them.

        Args:
            data: the whole file; with `max_bytes`, what there is of it.
            max_bytes: decode from this many first bytes alone: planes behind them are replaced by their stand-ins.
                `inspect` lists useful numbers under `prefixes`.
            views: decode these views alone, in this order, each as it is in the whole file; None for all.
            lost: give a list to decode what is intact of a damaged or cut file; it is filled with the names of the
                planes that are not.
            model: the network for a file of photos, by path or name; None to find it among the artifacts by its hash.
            watch: filled with seconds per stage.

        Raises:
            FormatError: damaged, cut short, foreign, or beyond the limits; a prefix too short for any picture.
            InputError: `data` is no bytes, `max_bytes` is below 1, or `views` are not different views of the file.
            ModelError: the file carries photos, and the network that it names is not at hand.
        """
        from .container.reader import read_container
        from .modes.decoder import decode_file

        check_is(data, bytes | bytearray | memoryview, *BYTES)
        if max_bytes is not None and max_bytes < 1:
            raise InputError(f"{max_bytes}, expected 1 or more", where="max_bytes")
        watch = watch or Stopwatch()
        with watch.stage("parse"):
            is_prefix, is_damaged, first = max_bytes is not None, lost is not None, memoryview(data)[:max_bytes]
            file = read_container(first, self.limits, is_prefix=is_prefix, is_damaged=is_damaged, views=views)
            if lost is not None:
                lost += file.lost
        return decode_file(file, self.store, threads=self.threads, model=model, watch=watch, told=self.told)

    def convert(
        self, source: StrPath | Sequence[StrPath], target: StrPath, **options: Unpack[ExportKeywords]
    ) -> list[str]:
        """Gaussian files to another format: the very bytes that `tinysplat convert` and `decode` write.

            ts.convert("room.tsplat", "room.ply")
            ts.convert(["room.tsplat", "desk.ply"], "both.spz", crop=(-1, -1, 0, 1, 1, 4), rotate="x,90")

        Args:
            source: a file, or several, which become one list.
            target: the file to write; its ending tells the format.
            **options: of `recipe.request.ExportRequest`, by the names of the command's.

        Returns:
            What the format could not keep, one line each.

        Raises:
            FormatError: a damaged `.tsplat` file.
            InputError: a file or an option that cannot be used, or nothing is left.
        """
        from .recipe.export import exported, write
        from .recipe.request import ExportRequest

        request = ExportRequest.of(**options)
        sources: Sequence[Any] = source if isinstance(source, list | tuple) else [source]
        for value in sources:
            check_is(value, PATH, "source", "a path")
        check_is(target, PATH, "target", "a path")
        files = [os.fspath(value) for value in sources]
        parts = [(file, self._loaded(file, request.views)) for file in files]
        origin = files[0] if len(files) == 1 and files[0].lower().endswith(SUFFIX) else None
        return write(target, exported(parts, os.fspath(target), request, self, self.told), request, self, origin)

    def _loaded(self, file: str, views: Sequence[int] | None) -> Gaussians:
        from .formats import table
        from .gaussian.editing import select_views

        with within(file):
            if file.lower().endswith(SUFFIX):
                return self.decompress(read_limited(file, MAX_FILE_BYTES), views=views)
            gaussians = table.load_gaussians(file)
            return gaussians if views is None else select_views(gaussians, views)

    def render(
        self,
        gaussians: Gaussians,
        camera: Camera,
        size: tuple[int, int] | None = None,
        *,
        dilation: str = "own",
        order: str = "near",
        threads: int | None = None,
        **options: Unpack[PictureOptions],
    ) -> Any:
        """See `tinysplat_runtime.render.render`, whose options these are."""
        from .render import render as render_gaussians

        asked = self.threads if threads is None else threads
        return render_gaussians(gaussians, camera, size, dilation=dilation, order=order, threads=asked, **options)


_shared = lru_cache(maxsize=1)(Runtime)


def _door(method: Callable[Concatenate[Runtime, P], T]) -> Callable[P, T]:
    """A method as a function, on the runtime that lives as long as the process; arguments and help are the method's."""

    @wraps(method)
    def call(*args: P.args, **options: P.kwargs) -> T:
        return method(_shared(), *args, **options)

    parameters = list(signature(method).parameters.values())[1:]
    call.__signature__ = signature(method).replace(parameters=parameters)  # type: ignore[attr-defined]
    return call


predict = _door(Runtime.predict)
compress = _door(Runtime.compress)
encode = _door(Runtime.encode)
decompress = _door(Runtime.decompress)
render = _door(Runtime.render)
convert = _door(Runtime.convert)


def load_gaussians(
    path: StrPath,
    grid: tuple[int, int, int] | None = None,
    cameras: Sequence[Camera] | None = None,
    max_bytes: int | None = None,
) -> Gaussians:
    """Read a `.tsplat` file, or a Gaussian file of another format as `formats.table.load_gaussians` does.

    Raises:
        FormatError: a damaged `.tsplat` file.
        InputError: names the file: missing, damaged, or options that a `.tsplat` file, which has cameras, cannot take.
    """
    check_is(path, PATH, "path", "a path")
    if not os.fspath(path).lower().endswith(SUFFIX):
        from .formats import table

        return table.load_gaussians(path, grid, cameras, **({} if max_bytes is None else {"max_bytes": max_bytes}))
    if (grid, cameras, max_bytes) != (None, None, None):
        raise InputError("a .tsplat file has a grid and cameras of its own; expected none", where=str(path))
    return _shared()._loaded(os.fspath(path), None)


def save_gaussians(path: StrPath, gaussians: Gaussians, **options: Unpack[SaveKeywords]) -> list[str]:
    """Write a file of the format that its ending tells, with the bytes that `tinysplat convert` writes.

    Args:
        path: `.tsplat`, or one of `formats.table.FORMATS`.
        gaussians: any.
        **options: of `recipe.request.ExportRequest`, and for a `.tsplat` file those of `CompressRequest`.

    Returns:
        What the format could not keep, one line each.

    Raises:
        InputError, NumericError: as `compress`, or as `convert`.
    """
    check_is(path, PATH, "path", "a path")
    check_is(gaussians, Gaussians, *GAUSSIANS)
    from .recipe.export import save

    return save(path, gaussians, options, _shared())


def inspect(data: bytes) -> JsonObject:
    """What a file holds, without decoding planes; see `tinysplat_runtime.container.inspection.inspect_bytes`."""
    from .container.inspection import inspect_bytes

    check_is(data, bytes | bytearray | memoryview, *BYTES)
    return inspect_bytes(data)
