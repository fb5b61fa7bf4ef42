"""Where subjects come from: scene folders, data sets in chunks, and the paths that a user gives.

Scene folders bring their windows in `eval_index.json`, data sets in public indices:

    {"near": 2.0, "far": 9.7, "windows": [{"kind": "near", "context": [2, 5], "target": [3, 4]}, …]}

What cannot be used is left out with the reason, by window where one window is at fault, by scene otherwise. Trust
boundary: files are bounded in size, and what they hold is checked field by field.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from tinysplat.datasets import SPECS, ChunkFolder, Window, read_paper_index
from tinysplat.datasets.chunks import INDEX_FILE
from tinysplat.datasets.indices import frame_indices, read_object
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.scenes import Scene
from tinysplat_runtime.system.files import StrPath, read_limited
from tinysplat_runtime.system.jsonfields import JsonObject

from ..rows import digest
from .cases import LeftOut, PhotoViews, Shots, Source

EVAL_INDEX = "eval_index.json"
MAX_INDEX_BYTES = 16 * 1000 * 1000


@dataclass(frozen=True)
class FolderSource(Source):
    """A scene folder with `eval_index.json`; near and far replace the index's."""

    path: Path
    near: float | None = None
    far: float | None = None

    @property
    def name(self) -> str:
        """The folder's own name."""
        return self.path.resolve().name

    def scene(self) -> Scene:
        """The scene with its depth range: the option's, else the index's, else the cameras file's."""
        scene = load_scene(self.path)
        index = read_index(self.path / EVAL_INDEX)
        near, far = (stated_depth(index, name, self.path / EVAL_INDEX) for name in ("near", "far"))
        return replace(scene, near=self.near or near or scene.near, far=self.far or far or scene.far)

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """See `Source`."""
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

    def shots(self, window: Window, size: tuple[int, int]) -> Shots:
        """See `Source`."""
        whole = self.scene()
        near, far = whole.depth_range()
        context, targets = (whole.resized(*size).views(indices) for indices in (window.context, window.targets))
        seen = PhotoViews(targets.images(judged=True), tuple(targets.cameras))
        return Shots(PhotoViews(context.images(), tuple(context.cameras)), seen, near, far, context)

    def fingerprint(self, window: Window) -> str:
        """Of the cameras, the depth range and the photos' sizes and times of change."""
        scene = self.scene()
        cameras = read_limited(self.path / CAMERAS_FILE, MAX_INDEX_BYTES).decode("utf-8", "replace")
        photos = []
        for i in sorted({*window.context, *window.targets}):
            path, mask = scene.frames[i].path, scene.frames[i].mask
            photos.append([path.name, _stat(path) if path.is_file() else None, *([_stat(mask.path)] if mask else [])])
        return digest(cameras, scene.near, scene.far, photos)


@dataclass(frozen=True)
class ChunkSource(Source):
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

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """See `Source`."""
        return [self.window], []

    def shots(self, window: Window, size: tuple[int, int]) -> Shots:
        """See `Source`."""
        spec = SPECS[self.dataset]
        scene = _chunk_folder(self.folder, self.dataset).scene(self.key)
        context, targets = (scene.views(indices, size) for indices in (window.context, window.targets))
        seen = PhotoViews(targets[0], tuple(targets[1]))
        return Shots(PhotoViews(context[0], tuple(context[1])), seen, self.near or spec.near, self.far or spec.far)

    def fingerprint(self, window: Window) -> str:
        """Of the chunk's size and time of change, and the depth range."""
        path = self.folder / _chunk_folder(self.folder, self.dataset).chunks[self.key]
        return digest(self.key, self.near, self.far, _stat(path))


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
        paths: scene folders, folders of scene folders, or folders of chunks.
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
            own, lost = _sources_at(path, index, dataset, near, far)
        except TinySplatError as error:
            own, lost = [], [LeftOut(str(path), str(error))]
        sources += own
        left_out += lost
    return sources, left_out


def _sources_at(
    path: Path, index: StrPath | None, dataset: str, near: float | None, far: float | None
) -> tuple[list[Source], list[LeftOut]]:
    if not path.is_dir():
        fault = "no such folder" if not path.exists() else f"a file that ends in '{path.suffix}'"
        raise InputError(f"{fault}; accepted are scene folders and chunk folders")
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
    wanted = read_paper_index(index, dataset)
    missing = [key for key in wanted if key not in chunks]
    # Scenes of one chunk follow each other, so that each chunk is loaded once.
    present = sorted((key for key in wanted if key in chunks), key=lambda key: (chunks[key], key))
    sources: list[Source] = [ChunkSource(path, dataset, key, wanted[key], near, far) for key in present]
    if not missing:
        return sources, []
    why = f"{len(missing)} scenes of {index} are not here, such as {missing[0]}"
    return sources, [LeftOut(str(path), why, len(missing))]


@lru_cache(maxsize=8)
def _chunk_folder(path: Path, dataset: str) -> ChunkFolder:
    """A folder's index is large; it is read once per process."""
    return ChunkFolder(path, SPECS[dataset])


def _stat(path: Path) -> list[int]:
    stat = path.stat()
    return [stat.st_size, stat.st_mtime_ns]


# ---- eval_index.json ----------------------------------------------------------------------------------------------


def read_index(path: Path) -> JsonObject:
    """The object in `eval_index.json`; InputError names the file if there is none."""
    if not path.is_file():
        raise InputError(f"no {EVAL_INDEX} in this folder", where=str(path.parent))
    return read_object(path, MAX_INDEX_BYTES, "with windows")


def stated_depth(index: JsonObject, name: str, path: Path) -> float | None:
    """`near` or `far` of an index, None where it states none; InputError if it is no depth."""
    value = index.get(name)
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float) or not value > 0):
        raise InputError(f"{str(value)[:20]}, expected a depth > 0", where=f"{path}: {name}")
    return value


def parse_window(entry: object, frames: int, where: str) -> Window:
    """A window out of an entry of `windows`; InputError names the field, whose frames must be below `frames`."""
    if not isinstance(entry, dict):
        raise InputError("expected an object with context and target", where=where)
    kind = entry.get("kind", "window")
    if not isinstance(kind, str) or not kind.isidentifier():
        raise InputError(f"{str(kind)[:40]!r}, expected a word", where=f"{where}.kind")
    context, targets = (frame_indices(entry, name, where) for name in ("context", "target"))
    for name, indices in (("context", context), ("target", targets)):
        for i in indices:
            if i >= frames:
                raise InputError(f"frame {i}, but the scene has 0 to {frames - 1}", where=f"{where}.{name}")
    if len(set(context)) < len(context):
        raise InputError(f"{list(context)} names a frame twice", where=f"{where}.context")
    return Window(kind, context, targets)
