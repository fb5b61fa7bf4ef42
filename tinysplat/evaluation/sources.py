"""What there is to measure: windows of scene folders, of data-set chunks, and Gaussian files.

A *window* names the context frames that a network gets and the target frames that its Gaussians are rendered at and
held against. Scene folders bring theirs in `eval_index.json` (`scene_index`), data sets in public indices.

A Gaussian file is a window of its own, without photos: its targets are the cameras in its arrays `target_K` and
`target_c2w`, or else the midpoints between neighbouring views.

What cannot be used is left out with the reason, by window where one window is at fault, by scene otherwise.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tinysplat.datasets import SPECS, ChunkFolder, read_paper_index
from tinysplat.datasets.chunks import INDEX_FILE
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.render import between
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.scenes import Scene
from tinysplat_runtime.system.files import StrPath, read_limited
from tinysplat_runtime.system.stopwatch import Stopwatch

from ..measure.subjects.index import covered_pixels
from .scene_index import EVAL_INDEX, MAX_INDEX_BYTES, Window, parse_window, read_depth, read_index, stated_depth

GAUSSIAN_SUFFIXES = (".npz", ".safetensors")


@dataclass(frozen=True)
class LeftOut:
    """Something that was not measured, and why, in a line.

    Attributes:
        where: scene, and window where only one is at fault.
        why: one line.
        count: windows lost, as far as can be told; a scene whose index cannot be read counts as one.
    """

    where: str
    why: str
    count: int = 1

    def __str__(self) -> str:
        return f"left out {self.where}: {self.why}"


@dataclass(frozen=True, eq=False)
class Case:
    """A window brought to Gaussians.

    Attributes:
        gaussians: the network's output, or the file's.
        cameras: T target cameras at the size of evaluation.
        photos: (T, H, W, 3) float32 target photos, or None.
        nearest: (T, H, W, 3) float32, the context photo taken from nearest to each target, or None.
        depths: (H, W) true depth per target, 0 where unknown, or None.
        covered: (T, H, W) bool, of `covered_pixels`, or None.
        seconds: of the stage `network`.
    """

    gaussians: Gaussians
    cameras: tuple[Camera, ...]
    photos: NDArray | None
    nearest: NDArray | None
    depths: tuple[NDArray | None, ...]
    covered: NDArray | None
    seconds: dict[str, float]


class Source(Protocol):
    """A scene with windows. Sources are small and picklable: worker processes read photos themselves."""

    @property
    def name(self) -> str:
        """The scene's name in results."""

    @property
    def needs_network(self) -> bool:
        """Whether a model turns its photos into Gaussians."""

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """Windows that can be tried, and those whose entry is at fault; InputError if there is no index to read."""

    def load(self, window: Window, model: str, size: tuple[int, int], runtime: Runtime) -> Case:
        """Bring a window to Gaussians; TinySplatError names what is at fault."""

    def fingerprint(self, window: Window) -> str:
        """Changes when what the window's figures depend on, apart from model and code, changes."""


@dataclass(frozen=True)
class FolderSource:
    """A scene folder with `eval_index.json`; near and far replace the index's."""

    path: Path
    near: float | None = None
    far: float | None = None

    @property
    def name(self) -> str:
        """The folder's own name."""
        return self.path.resolve().name

    @property
    def needs_network(self) -> bool:
        """Photos need one."""
        return True

    def scene(self) -> Scene:
        """The scene with its depth range: the option's, else the index's, else the cameras file's."""
        scene = load_scene(self.path)
        index = read_index(self.path / EVAL_INDEX)
        near, far = (stated_depth(index, name, self.path / EVAL_INDEX) for name in ("near", "far"))
        return replace(scene, near=self.near or near or scene.near, far=self.far or far or scene.far)

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """See `Source.windows`."""
        path = self.path / EVAL_INDEX
        entries, frames = read_index(path).get("windows"), len(load_scene(self.path).frames)
        if not isinstance(entries, list) or not entries:
            raise InputError("no windows to evaluate", where=str(path))
        windows, left_out = [], []
        for i, entry in enumerate(entries):
            try:
                windows.append(parse_window(entry, frames, f"windows[{i}]"))
            except InputError as error:
                left_out.append(LeftOut(f"{self.name} ({path})", str(error)))
        return windows, left_out

    def load(self, window: Window, model: str, size: tuple[int, int], runtime: Runtime) -> Case:
        """See `Source.load`."""
        scene = self.scene().resized(*size)
        near, far = scene.depth_range()
        context, targets = scene.views(window.context), scene.views(window.targets)
        depths = tuple(self._depths(window.targets, targets.cameras))
        return _predicted(
            (context.images(), context.cameras), (targets.images(), targets.cameras), depths,
            model=model, near=near, far=far, runtime=runtime,
        )  # fmt: skip

    def fingerprint(self, window: Window) -> str:
        """Of the cameras, the depth range and the photos' sizes and times of change."""
        scene = self.scene()
        cameras = hashlib.sha256(read_limited(self.path / CAMERAS_FILE, MAX_INDEX_BYTES)).hexdigest()
        photos = []
        for i in sorted({*window.context, *window.targets}):
            path = scene.frames[i].path
            stat = path.stat() if path.is_file() else None
            photos.append([path.name, stat and stat.st_size, stat and stat.st_mtime_ns])
        return _digest([cameras, scene.near, scene.far, photos])

    def _depths(self, indices: Sequence[int], cameras: Sequence[Camera]) -> Iterable[NDArray | None]:
        """True depth per frame at the cameras' size, where `cameras.json` names files of it."""
        document = json.loads(read_limited(self.path / CAMERAS_FILE, MAX_INDEX_BYTES))
        scale = document.get("depth_scale")
        for index, camera in zip(indices, cameras, strict=True):
            name = document["frames"][index].get("depth")
            if not isinstance(name, str) or not isinstance(scale, int | float) or not scale > 0:
                yield None
            elif (self.path / name).resolve().is_relative_to(self.path.resolve()):
                yield read_depth(self.path / name, float(scale), camera.height, camera.width)
            else:
                raise InputError(f"'{name}' leaves the scene's folder", where=f"{self.path}: frames[{index}].depth")


@dataclass(frozen=True)
class ChunkSource:
    """One scene of a data set in chunks, with its window of a public index; near and far replace the data set's."""

    folder: Path
    dataset: str
    key: str
    window: Window
    near: float | None = None
    far: float | None = None

    @property
    def name(self) -> str:
        """The scene's key."""
        return self.key

    @property
    def needs_network(self) -> bool:
        """Photos need one."""
        return True

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """See `Source.windows`."""
        return [self.window], []

    def load(self, window: Window, model: str, size: tuple[int, int], runtime: Runtime) -> Case:
        """See `Source.load`."""
        spec = SPECS[self.dataset]
        scene = _chunk_folder(self.folder, self.dataset).scene(self.key)
        return _predicted(
            scene.views(window.context, size), scene.views(window.targets, size), (None,) * len(window.targets),
            model=model, near=self.near or spec.near, far=self.far or spec.far, runtime=runtime,
        )  # fmt: skip

    def fingerprint(self, window: Window) -> str:
        """Of the chunk's size and time of change, and the depth range."""
        stat = (self.folder / _chunk_folder(self.folder, self.dataset).chunks[self.key]).stat()
        return _digest([self.key, self.near, self.far, stat.st_size, stat.st_mtime_ns])


@dataclass(frozen=True)
class FileSource:
    """A Gaussian file: what coding loses can be measured without photos."""

    path: Path

    @property
    def name(self) -> str:
        """The file's stem."""
        return self.path.stem

    @property
    def needs_network(self) -> bool:
        """It is a network's output already."""
        return False

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """See `Source.windows`."""
        gaussians = load_gaussians(self.path)
        views = len(gaussians.cameras)
        return [Window("file", tuple(range(views)), tuple(range(len(self._targets(gaussians)))))], []

    def load(self, window: Window, model: str, size: tuple[int, int], runtime: Runtime) -> Case:
        """See `Source.load`; `model` and `size` are the file's own."""
        gaussians = load_gaussians(self.path)
        cameras = tuple(self._targets(gaussians))
        return Case(gaussians, cameras, None, None, (None,) * len(cameras), None, {})

    def fingerprint(self, window: Window) -> str:
        """Of the file's size and time of change."""
        stat = self.path.stat()
        return _digest([stat.st_size, stat.st_mtime_ns])

    def _targets(self, gaussians: Gaussians) -> list[Camera]:
        if not gaussians.is_per_pixel:
            raise InputError("no cameras, expected K and c2w per view", where=str(self.path))
        size = {"width": gaussians.cameras[0].width, "height": gaussians.cameras[0].height}
        if self.path.suffix == ".npz":
            with np.load(self.path, allow_pickle=False) as arrays:
                if {"target_K", "target_c2w"} <= set(arrays.files):
                    pairs = zip(arrays["target_K"], arrays["target_c2w"], strict=True)
                    return [Camera(K, c2w, **size) for K, c2w in pairs]
        views = len(gaussians.cameras)
        return between(gaussians.cameras, 2 * views - 1)[1::2] if views > 1 else list(gaussians.cameras)


def find_sources(
    paths: Iterable[StrPath],
    *,
    index: StrPath | None = None,
    dataset: str = "re10k",
    near: float | None = None,
    far: float | None = None,
) -> tuple[list[Source], list[LeftOut]]:
    """Sources behind the paths a user gave.

    Args:
        paths: scene folders, folders of scene folders, folders of chunks, or Gaussian files.
        index: public evaluation index; needed for chunks.
        dataset: key of `SPECS` for chunks.
        near, far: replace every source's own depth range.

    Returns:
        Sources by path, folders' children by name; and paths that lead to none.
    """
    sources: list[Source] = []
    left_out: list[LeftOut] = []
    for path in map(Path, paths):
        try:
            found, lost = _sources_at(path, index, dataset, near, far)
        except TinySplatError as error:
            found, lost = [], [LeftOut(str(path), str(error))]
        sources += found
        left_out += lost
    return sources, left_out


def _predicted(
    context: tuple[NDArray, Sequence[Camera]],
    targets: tuple[NDArray, Sequence[Camera]],
    depths: tuple[NDArray | None, ...],
    *,
    model: str,
    near: float,
    far: float,
    runtime: Runtime,
) -> Case:
    watch = Stopwatch()
    graph = runtime.store.network(model)
    with watch.stage("network"):
        gaussians = predict(*context, near, far, graph)
    centres = np.stack([camera.centre for camera in context[1]])
    nearest = [int(np.linalg.norm(centres - camera.centre, axis=1).argmin()) for camera in targets[1]]
    covered = np.stack([covered_pixels(camera, context[1], near, far) for camera in targets[1]])
    return Case(gaussians, tuple(targets[1]), targets[0], context[0][nearest], depths, covered, watch.seconds)


def _sources_at(
    path: Path, index: StrPath | None, dataset: str, near: float | None, far: float | None
) -> tuple[list[Source], list[LeftOut]]:
    if path.is_file() and path.suffix.lower() in GAUSSIAN_SUFFIXES:
        return [FileSource(path)], []
    if not path.is_dir():
        found = "no such folder" if not path.exists() else f"a file that ends in '{path.suffix}'"
        raise InputError(f"{found}; accepted are scene folders, chunk folders and {', '.join(GAUSSIAN_SUFFIXES)}")
    if (path / CAMERAS_FILE).is_file():
        return [FolderSource(path, near, far)], []
    if (path / INDEX_FILE).is_file():
        return _chunk_sources(path, index, dataset, near, far)
    children = sorted(child for child in path.iterdir() if (child / CAMERAS_FILE).is_file())
    if not children:
        raise InputError(f"holds neither {CAMERAS_FILE}, nor folders with one, nor chunks with {INDEX_FILE}")
    return [FolderSource(child, near, far) for child in children], []


def _chunk_sources(
    path: Path, index: StrPath | None, dataset: str, near: float | None, far: float | None
) -> tuple[list[Source], list[LeftOut]]:
    if index is None:
        raise InputError("a folder of chunks needs its evaluation index: give --index F.json")
    chunks = _chunk_folder(path, dataset).chunks
    wanted = read_paper_index(index)
    missing = [key for key in wanted if key not in chunks]
    # Scenes of one chunk follow each other, so that each chunk is loaded once.
    present = sorted((key for key in wanted if key in chunks), key=lambda key: (chunks[key], key))
    sources: list[Source] = [
        ChunkSource(path, dataset, key, Window(dataset, wanted[key].context, wanted[key].targets), near, far)
        for key in present
    ]
    if not missing:
        return sources, []
    why = f"{len(missing)} scenes of {index} are not here, such as {missing[0]}"
    return sources, [LeftOut(str(path), why, len(missing))]


@lru_cache(maxsize=8)
def _chunk_folder(path: Path, dataset: str) -> ChunkFolder:
    """A folder's index is large; it is read once per process."""
    return ChunkFolder(path, SPECS[dataset])


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:20]
