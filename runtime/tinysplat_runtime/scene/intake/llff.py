"""`poses_bounds.npy`, as LLFF writes it beside the photos in `images/`.

A row for each photo in the order of names: a 3x5 matrix, whose columns are the camera's down, right and backward axes,
its centre, and (height, width, focal length); then the nearest and farthest depth. Source: github.com/Fyusion/LLFF,
"Using your own poses without running COLMAP". Pictures may since have been scaled: K follows their size.
"""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, within
from ...system.files import parsing, read_limited
from ..cameras import Camera, intrinsics, posed
from ..images import image_size
from ..scenes import Frame, Scene
from .photos import find_folder, photos_in

LLFF_FILE = "poses_bounds.npy"

PHOTOS = "images"

_MAX_BYTES = 1 << 24  # a row takes 136 bytes
_ROW = 17


def load_llff(folder: Path) -> Scene:
    """Read a folder with `poses_bounds.npy`.

    Raises:
        InputError: names the file and the row at fault, or the photos that are not as many as rows.
    """
    file = folder / LLFF_FILE
    rows = _rows(file)
    photos = photos_in(find_folder(folder, PHOTOS) or folder / PHOTOS)
    if len(photos) != len(rows):
        raise InputError(f"{len(rows)} poses for {len(photos)} photos in {PHOTOS}/, expected one each", where=str(file))
    frames = tuple(
        Frame(_camera(file, i, row, photo), photo) for i, (row, photo) in enumerate(zip(rows, photos, strict=True))
    )
    return Scene(folder, frames, float(rows[:, 15].min()), float(rows[:, 16].max()))


def _rows(file: Path) -> NDArray:
    """(V, 17) float64."""
    data = read_limited(file, _MAX_BYTES)
    with within(str(file)), parsing(".npy file"):
        rows = np.load(io.BytesIO(data), allow_pickle=False)
    if rows.ndim != 2 or rows.shape[1] != _ROW or rows.dtype.kind not in "fi" or not len(rows):
        raise InputError(f"shape {rows.shape} of {rows.dtype}, expected (V, {_ROW}) numbers", where=str(file))
    if not np.isfinite(rows).all():
        raise InputError("holds NaN or infinity, expected finite numbers", where=str(file))
    return rows.astype(np.float64)


def _camera(file: Path, i: int, row: NDArray, photo: Path) -> Camera:
    down, right, backward, centre, (height, width, focal) = row[:15].reshape(3, 5).T
    c2w = posed(np.stack([right, down, -backward], axis=1), centre)
    size = image_size(photo)
    if min(height, width) < 1:
        raise InputError(f"{width:g}x{height:g} pixels, expected 1 or more", where=f"{file}: row {i}")
    K = intrinsics(focal * size[1] / width, focal * size[0] / height, size[1] / 2, size[0] / 2)
    with within(f"{file}: row {i}", ", "):
        return Camera(K, c2w, size[1], size[0])
