"""Photos brought to another size, as cameras are: what a pixel shows is where `Camera.resized` puts it."""

import numpy as np
from numpy.typing import NDArray

from .cameras import Camera

LANCZOS_LOBES = 3


def resize_cover(image: NDArray, height: int, width: int, whole: tuple[int, int] | None = None) -> NDArray:
    """Scale an image to cover height × width and crop it around its centre: the picture that `Camera.resized` sees.

    A Lanczos filter of three lobes, widened when shrinking so that nothing aliases, and normalised at the border
    over the pixels that exist. Sums run in a fixed order on one thread: the same input gives the same bits.

    Args:
        image: (H, W, 3) uint8, or floating point in [0, 1].
        height, width: rows and columns wanted.
        whole: (H, W) of the photo that was shrunk to `image` by `read_image`; None for the image's own.

    Returns:
        (height, width, 3) float32 in [0, 1].
    """
    rows, columns = whole or image.shape[:2]
    # The camera of the image with unit intrinsics: where it puts a pixel is the definition of where we put it.
    to_output = Camera(np.eye(3), np.eye(4), width=columns, height=rows).resized(height, width).K
    shrink = rows // image.shape[0]
    return _moved(image, height, width, to_output @ np.diag([shrink, shrink, 1.0]))


def scaled(image: NDArray, height: int, width: int) -> NDArray:
    """As `resize_cover`, but stretches all of (H, W, 3) to (height, width, 3), each side by its own factor."""
    return _moved(image, height, width, np.diag([width / image.shape[1], height / image.shape[0], 1.0]))


def _moved(image: NDArray, height: int, width: int, to_output: NDArray) -> NDArray:
    """The (H, W, 3) image where `to_output` (3, 3), a scaling and a shift, puts it: (height, width, 3) float32."""
    white = np.float32(255 if image.dtype == np.uint8 else 1)
    rows = _resample(image, *_lanczos_taps(image.shape[0], height, to_output[1, 1], to_output[1, 2]))  # (height, W, 3)
    columns = _resample(
        rows.swapaxes(0, 1), *_lanczos_taps(image.shape[1], width, to_output[0, 0], to_output[0, 2])
    )  # (width, height, 3)
    return np.ascontiguousarray(np.clip(columns / white, 0, 1).swapaxes(0, 1))


def _lanczos_taps(n_in: int, n_out: int, scale: float, shift: float) -> tuple[NDArray, NDArray]:
    """Source indices and weights, both (taps, n_out), of outputs at x_out = scale·x_in + shift, centres at half."""
    centre = (np.arange(n_out) + 0.5 - shift) / scale
    stretch = max(1 / scale, 1.0)
    radius = LANCZOS_LOBES * stretch
    index = np.floor(centre - radius).astype(np.int64) + np.arange(int(np.ceil(2 * radius)) + 1)[:, None]
    distance = (index + 0.5 - centre) / stretch
    weight = np.where(np.abs(distance) < LANCZOS_LOBES, np.sinc(distance) * np.sinc(distance / LANCZOS_LOBES), 0)
    weight[(index < 0) | (index >= n_in) | (np.abs(weight) < 1e-9)] = 0  # sinc's zeros: whole-pixel crops copy
    return index.clip(0, n_in - 1), (weight / weight.sum(axis=0)).astype(np.float32)


def _resample(image: NDArray, index: NDArray, weight: NDArray) -> NDArray:
    """Weighted sums (n_out, …) float32 of an image's (n_in, …) rows."""
    out = np.zeros((index.shape[1], *image.shape[1:]), np.float32)
    for rows, factors in zip(index, weight, strict=True):
        out += image[rows] * factors[:, None, None]
    return out
