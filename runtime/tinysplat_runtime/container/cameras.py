"""Cameras of a file: the sections CAMS and STEP, and the intrinsics of a layer's own grid. Layout: docs/FORMAT.md."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, InputError
from ..scene.cameras import MAX_IMAGE_SIDE, MAX_POSITION, Camera
from ..scene.viewpoints import Viewpoint, viewpoint_of
from . import layout as L
from .sections import Cursor, NewSection, Section, packed_columns, read_columns

COLUMNS = 19
"""fx, fy, cx, cy, skew and width, height in pixels; c2w's upper three rows."""

INTRINSICS = 5

STEP_COLUMNS = 10
"""A rotation vector in radians and a shift in scene units, in the camera's axes; 1 where it is the camera's alone;
gains of red, green and blue."""

MOST_TURN = 4.0
"""Radians; more than half a turn about any axis."""

MOST_GAIN = 1024.0
"""Of a colour; the least is its inverse."""


def intrinsics(K: NDArray) -> tuple[float, ...]:
    """The numbers of K (3, 3) float64 in the order that files have them in."""
    return K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1]


def camera_sections(cameras: Sequence[Camera]) -> list[NewSection]:
    """The sections of cameras, where there are any, and of their steps, where they have them."""
    rows = [(*intrinsics(c.K), c.width, c.height, *c.c2w[:3].ravel()) for c in cameras]
    sections = [NewSection(L.CAMERAS, 0, packed_columns(np.array(rows, np.float64)))] if rows else []
    if any(isinstance(camera, Viewpoint) for camera in cameras):
        found = [(*one.turn, *one.shift, one.is_alone, *one.gain) for one in map(viewpoint_of, cameras)]
        sections.append(NewSection(L.STEPS, 0, packed_columns(np.array(found, np.float64)), is_required=False))
    return sections


def rounded_cameras(cameras: Sequence[Camera], origin: NDArray) -> tuple[Camera, ...]:
    """Cameras as precise as nothing that is computed of them needs more: float32, places relative to (3,) `origin`."""
    rounded = []
    for camera in cameras:
        c2w = camera.c2w.astype(np.float32).astype(np.float64)
        c2w[:3, 3] = (camera.centre - origin).astype(np.float32) + origin
        narrow = replace(camera, K=camera.K.astype(np.float32), c2w=c2w)
        if isinstance(narrow, Viewpoint):
            fields = {name: getattr(narrow, name).astype(np.float32) for name in ("turn", "shift", "gain")}
            narrow = replace(narrow, **fields)
        rounded.append(narrow)
    return tuple(rounded)


def with_steps(cameras: Sequence[Camera], section: Section) -> tuple[Camera, ...]:
    """Cameras with the steps of a section; FormatError naming section and view where they are none."""
    cursor = Cursor(section)
    numbers = read_columns(cursor, len(cameras), STEP_COLUMNS)
    cursor.finish()
    found = []
    for view, (camera, step) in enumerate(zip(cameras, numbers, strict=True)):
        turn, shift, alone, gain = step[:3], step[3:6], step[6], step[7:]
        is_step = np.isfinite(step).all() and np.abs(turn).max() <= MOST_TURN and np.abs(shift).max() <= MAX_POSITION
        is_step &= gain.min() >= 1 / MOST_GAIN and gain.max() <= MOST_GAIN
        cursor.require(bool(is_step) and alone in (0, 1), f"view {view}: a step of {step.tolist()}")
        found.append(Viewpoint.of(camera, turn=turn, shift=shift, is_alone=bool(alone), gain=gain))
    return tuple(found)


def read_numbers(section: Section, count: int) -> NDArray:
    """(count, 19) float64 numbers of the section; FormatError where they are not so many."""
    cursor = Cursor(section)
    numbers = read_columns(cursor, count, COLUMNS)
    cursor.finish()
    return numbers


def cameras_of(section: Section, numbers: NDArray, views: Sequence[int]) -> tuple[Camera, ...]:
    """The cameras of some views of `numbers` (V, 19); FormatError naming section and view if they make none."""
    cameras = []
    for view in views:
        K, (width, height) = numbers[view, :INTRINSICS], numbers[view, INTRINSICS : INTRINSICS + 2].tolist()
        is_size = 1 <= width <= MAX_IMAGE_SIDE and 1 <= height <= MAX_IMAGE_SIDE and not (width % 1 or height % 1)
        if not is_size:
            sizes = f"a picture of {width:g}x{height:g}, sides are 1 to {MAX_IMAGE_SIDE}"
            raise FormatError(sizes, where=f"{section.label}: view {view}")
        c2w = np.eye(4)
        c2w[:3] = numbers[view, INTRINSICS + 2 :].reshape(3, 4)
        cameras.append(_camera(section, view, K, c2w, int(height), int(width)))
    return tuple(cameras)


def scaled(camera: Camera, height: int, width: int) -> tuple[float, ...]:
    """fx, fy, cx, cy, skew of the camera's picture in another size."""
    across, down = width / camera.width, height / camera.height
    fx, fy, cx, cy, skew = intrinsics(camera.K)
    return fx * across, fy * down, cx * across, cy * down, skew * across


def has_own_intrinsics(cameras: Sequence[Camera], layer: Sequence[Camera]) -> bool:
    """Whether a layer's cameras have other intrinsics than the file's, scaled to its grid."""
    pairs = zip(cameras, layer, strict=True)
    return any(scaled(file, own.height, own.width) != intrinsics(own.K) for file, own in pairs)


def packed_intrinsics(cameras: Sequence[Camera]) -> bytes:
    """The columns of a layer's own intrinsics."""
    return packed_columns(np.array([intrinsics(camera.K) for camera in cameras]))


def layer_cameras(
    cursor: Cursor, cameras: Sequence[Camera], views: Sequence[int], height: int, width: int, *, own: int
) -> tuple[Camera, ...]:
    """Cameras of a layer's grid.

    Args:
        cursor: at the layer's own intrinsics, if it has any.
        cameras: the file's, of the views that are read.
        views: their numbers.
        height, width: of the grid.
        own: of how many views the layer has intrinsics; 0 where they are the file's, scaled.
    """
    if own:
        rows = read_columns(cursor, own, INTRINSICS)[list(views)]
    else:
        rows = np.array([scaled(camera, height, width) for camera in cameras])
    return tuple(
        _camera(cursor.section, view, K, camera.c2w, height, width)
        for view, K, camera in zip(views, rows, cameras, strict=True)
    )


def _camera(section: Section, view: int, numbers: NDArray, c2w: NDArray, height: int, width: int) -> Camera:
    fx, fy, cx, cy, skew = numbers.tolist()
    try:
        return Camera(np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]]), c2w, width, height)
    except InputError as error:
        raise FormatError(error.message, where=f"{section.label}: view {view}: {error.where}") from None
