"""What the official evaluations fix for each data set, and their public indices; docs/MEASURING.md has the sources.

An index is `{scene key: {"context": […], "target": […]} or null}`.
"""

import json
from dataclasses import dataclass

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import StrPath, read_limited
from tinysplat_runtime.system.jsonfields import JsonObject


@dataclass(frozen=True)
class DatasetSpec:
    """One data set as the official evaluations use it.

    Attributes:
        name: what commands call it.
        size: (height, width) that frames are prepared at unless asked otherwise.
        near, far: depth range that the released networks were run with unless asked otherwise, scene units.
        frame_shapes: (height, width) of stored frames; scenes with others are not evaluated.
        max_fov_degrees: scenes with a wider horizontal or vertical field of view are not evaluated.
    """

    name: str
    size: tuple[int, int]
    near: float
    far: float
    frame_shapes: tuple[tuple[int, int], ...]
    max_fov_degrees: float = 100.0


SPECS = {
    spec.name: spec
    for spec in (
        # near and far are MVSplat's; DepthSplat's networks were run with 0.5 and 100.
        DatasetSpec("re10k", (256, 256), 1.0, 100.0, ((360, 640),)),
        DatasetSpec("acid", (256, 256), 1.0, 100.0, ((360, 640),)),
        # Stored as `images_4` (540 × 960) or `images_8` (270 × 480).
        DatasetSpec("dl3dv", (256, 448), 0.5, 200.0, ((540, 960), (270, 480))),
    )
}

MAX_INDEX_BYTES = 64 * 1000 * 1000
"""RealEstate10K's, the largest there is, takes half a megabyte."""


@dataclass(frozen=True)
class Window:
    """Frames of one scene: those that a network gets, and those that its Gaussians are held against.

    Attributes:
        kind: `near`, `wide`, `multi` or a data set's name.
        context, targets: frames.
    """

    kind: str
    context: tuple[int, ...]
    targets: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.kind} {','.join(map(str, self.context))}"


def read_paper_index(path: StrPath, dataset: str) -> dict[str, Window]:
    """Windows of a data set by scene key; scenes that the index gives as null are not evaluated and left out.

    Raises:
        InputError: names the file and the scene at fault.
    """
    document = read_object(path, MAX_INDEX_BYTES, "of windows by scene key")
    return {key: _window(entry, dataset, f"{path}: {key}") for key, entry in document.items() if entry is not None}


def read_object(path: StrPath, max_bytes: int, what: str) -> JsonObject:
    """The object in a JSON file of at most `max_bytes`; InputError names the file, and says `what` was expected."""
    try:
        document = json.loads(read_limited(path, max_bytes))
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON ({error})", where=str(path)) from None
    if not isinstance(document, dict):
        raise InputError(f"expected an object {what}", where=str(path))
    return document


def _window(entry: object, dataset: str, where: str) -> Window:
    if not isinstance(entry, dict):
        raise InputError("expected an object with context and target, or null", where=where)
    return Window(dataset, frame_indices(entry, "context", where), frame_indices(entry, "target", where))


def frame_indices(entry: JsonObject, name: str, where: str) -> tuple[int, ...]:
    """A list of frame indices ≥ 0 out of a JSON object, at least one of them."""
    value = entry.get(name)
    if not isinstance(value, list) or not all(type(i) is int and i >= 0 for i in value):
        raise InputError(f"{json.dumps(value)[:60]}, expected a list of frame indices", where=f"{where}.{name}")
    if not value:
        raise InputError("no frames, expected at least one", where=f"{where}.{name}")
    return tuple(value)
