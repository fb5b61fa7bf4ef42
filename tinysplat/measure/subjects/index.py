"""What a scene folder brings for measuring: the windows of `eval_index.json`, depth maps, and which pixels its context
views can know of at all, by cameras and depth range, not by any model.

    {"near": 2.0, "far": 9.7, "windows": [{"kind": "near", "context": [2, 5], "target": [3, 4]}, …]}

Trust boundary: files are bounded in size, and what they hold is checked field by field.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat.datasets.indices import frame_indices
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import MAX_PIXELS
from tinysplat_runtime.system.files import check_readable, read_limited

from .cases import Window

EVAL_INDEX = "eval_index.json"
MAX_INDEX_BYTES = 16 * 1000 * 1000


DEPTHS = 16
"""Places along a pixel's ray, uniform in inverse depth from far to near."""

SHARE = 0.5
"""Share of them that must lie in the frame of a context view for the pixel to be covered."""


def read_index(path: Path) -> dict[str, Any]:
    """The object in `eval_index.json`; InputError names the file if there is none."""
    if not path.is_file():
        raise InputError(f"no {EVAL_INDEX} in this folder", where=str(path.parent))
    try:
        document = json.loads(read_limited(path, MAX_INDEX_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON ({error})", where=str(path)) from None
    if not isinstance(document, dict):
        raise InputError("expected an object with windows", where=str(path))
    return document


def stated_depth(index: dict[str, Any], name: str, path: Path) -> float | None:
    """`near` or `far` of an index, None where it states none; InputError if it is no depth."""
    value = index.get(name)
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float) or not value > 0):
        raise InputError(f"{str(value)[:20]}, expected a depth > 0", where=f"{path}: {name}")
    return value


def parse_window(entry: Any, frames: int, where: str) -> Window:
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


def read_depth(path: Path, scale: float, height: int, width: int) -> NDArray:
    """A 16-bit PNG of depth × scale, at the size of evaluation.

    Args:
        path: the file; 0 stands for no value.
        scale: values per scene unit.
        height, width: as `Camera.resized` covers and crops; the nearest sample is taken, as depths don't mix.

    Returns:
        (height, width) float32 in scene units.
    """
    from PIL import Image

    check_readable(path)
    try:
        with Image.open(path, formats=("PNG",)) as image:
            if image.mode not in ("I;16", "I;16B", "I") or image.width * image.height > MAX_PIXELS:
                found = f"{image.width}x{image.height} of mode {image.mode}"
                raise InputError(f"{found}, expected a 16-bit grey PNG", where=str(path))
            stored = np.asarray(image).astype(np.float32)
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"cannot be decoded ({str(error)[:120]})", where=str(path)) from None
    to_output = Camera(np.eye(3), np.eye(4), width=stored.shape[1], height=stored.shape[0]).resized(height, width).K
    rows, columns = (
        np.floor((np.arange(n) + 0.5 - to_output[axis, 2]) / to_output[axis, axis]).astype(int).clip(0, limit - 1)
        for n, axis, limit in ((height, 1, stored.shape[0]), (width, 0, stored.shape[1]))
    )
    return stored[np.ix_(rows, columns)] / np.float32(scale)


def covered_pixels(target: Camera, context: Sequence[Camera], near: float, far: float) -> NDArray:
    """Pixels whose ray runs inside the context views' frames: (H, W) bool.

    A place counts where any context view has it before its camera and within its picture, occluded or not. With
    targets between the contexts this leaves out the margins that no photo shows, whatever stands there.

    Args:
        target: the view looked at.
        context: the views that a network gets.
        near, far: z of the nearest and the farthest surface, scene units, 0 < near < far.
    """
    row, column = np.mgrid[: target.height, : target.width] + 0.5
    pixels = np.stack([column, row, np.ones_like(row)], axis=-1)
    rays = pixels @ np.linalg.inv(target.K).T @ target.c2w[:3, :3].T  # world, unit z in the target's frame
    inside = np.zeros((target.height, target.width))
    for inverse_depth in np.linspace(1 / far, 1 / near, DEPTHS):
        points = target.c2w[:3, 3] + rays / inverse_depth
        inside += np.any([_in_frame(points, camera) for camera in context], axis=0)
    return inside >= SHARE * DEPTHS


def _in_frame(points: NDArray, camera: Camera) -> NDArray:
    """Where world points (H, W, 3) appear in a camera's picture: (H, W) bool."""
    shown = (points - camera.c2w[:3, 3]) @ camera.c2w[:3, :3] @ camera.K.T
    z = shown[..., 2]
    x, y = (shown[..., i] / np.where(z > 0, z, 1) for i in (0, 1))
    return (z > 0) & (x >= 0) & (x <= camera.width) & (y >= 0) & (y <= camera.height)
