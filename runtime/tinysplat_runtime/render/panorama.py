"""360° pictures, equirectangular: longitudes along rows, ahead in the middle, latitudes along columns; six faces of a
cube put together. Files say what they are by XMP (Google's "Photo Sphere XMP").
"""

import math
import struct
import zlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..scene.cameras import Camera, intrinsics, posed
from ..scene.pictures import png_bytes

FACES: dict[str, NDArray] = {
    "front": np.eye(3),
    "right": np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "back": np.diag([-1, 1, -1]),
    "left": np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "up": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "down": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
}
"""(3, 3) turns from the picture's axes (x right, y down, z ahead) to those of each face's camera, which sees 90°."""

_MARGIN = 2  # pixels beyond 90°, so that what is between two pixels lies within one face
_HEADER_END = 33  # bytes of a PNG file's signature and header
_XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" '
    'GPano:ProjectionType="equirectangular"/></rdf:RDF></x:xmpmeta>'
)


def panorama(draw: Callable[[Camera], NDArray], camera: Camera, down: NDArray, height: int) -> NDArray:
    """All that is seen from a camera's place.

    Args:
        draw: a picture (H, W, 3) of what a camera sees.
        camera: the place, and what lies ahead.
        down: (3,) which way is down in the world; zero, or along the line of sight, for the camera's own.
        height: rows, at least 2.

    Returns:
        (height, 2 height, 3) float32.
    """
    latitude, longitude = (np.mgrid[:height, : 2 * height] + 0.5) * (math.pi / height)
    rays = np.stack([-np.sin(latitude) * np.sin(longitude), -np.cos(latitude), -np.sin(latitude) * np.cos(longitude)])
    focal, rotation = max(height // 2, 1), _upright(camera, down)
    side = 2 * (focal + _MARGIN)
    out = np.zeros((height, 2 * height, 3), np.float32)
    for turn in FACES.values():
        x, y, z = np.tensordot(turn, rays, 1)
        here = z >= np.maximum(np.abs(x), np.abs(y))
        K, c2w = intrinsics(focal, focal, side / 2, side / 2), posed(rotation @ turn.T, camera.centre)
        row, column = (focal * a[here] / z[here] + (side - 1) / 2 for a in (y, x))
        out[here] = _between(draw(Camera(K, c2w, side, side)), row, column)
    return out


def panorama_png(picture: NDArray) -> bytes:
    """A 360° picture as a PNG file that says so."""
    data, text = png_bytes(picture), b"iTXtXML:com.adobe.xmp" + bytes(5) + _XMP.encode()
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    return data[:_HEADER_END] + chunk + data[_HEADER_END:]


def _upright(camera: Camera, down: NDArray) -> NDArray:
    """(3, 3) camera-to-world rotation with y along `down` and z as near to what is ahead as that allows."""
    right = np.cross(down, camera.rotation[2])
    if np.linalg.norm(right) < 1e-3 * np.linalg.norm(down) or not down.any():
        return camera.rotation.T
    x, y = right / np.linalg.norm(right), down / np.linalg.norm(down)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _between(image: NDArray, row: NDArray, column: NDArray) -> NDArray:
    """(n, 3) of an image between its pixels, bilinear."""
    i, j = np.floor(row).astype(int), np.floor(column).astype(int)
    down, right = (row - i)[:, None], (column - j)[:, None]
    upper, lower = ((1 - right) * image[k, j] + right * image[k, j + 1] for k in (i, i + 1))
    mixed: NDArray = (1 - down) * upper + down * lower
    return mixed
