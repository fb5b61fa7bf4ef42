"""Lists of numbers as pictures: tiles that a Z-curve goes through, so that neighbours stay neighbours."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

TILE = 64
"""Side of a tile; for a list that fills less than one, the least power of two that holds it."""

LEAST_TILE = 16


def plane_shape(count: int) -> tuple[int, int]:
    """Height and width of the picture of so many numbers: tiles row by row, about as many across as down."""
    side = _side(count)
    tiles = -(-count // side**2)
    across = math.isqrt(tiles - 1) + 1
    return -(-tiles // across) * side, across * side


def to_plane(values: NDArray) -> NDArray:
    """(N,) as a picture (H, W) of the same dtype; the last number fills what is left."""
    height, width = plane_shape(len(values))
    side = _side(len(values))
    filled = np.full(height * width, values[-1], values.dtype)
    filled[: len(values)] = values
    tiles = filled.reshape(height // side, width // side, side * side)[:, :, _curve(side)]
    return np.ascontiguousarray(tiles.reshape(height // side, width // side, side, side).swapaxes(1, 2)).reshape(
        height, width
    )


def from_plane(plane: NDArray, count: int) -> NDArray:
    """Inverse of `to_plane`: (h, w) as (N,), N = `count`, of the same dtype."""
    height, width = plane.shape
    side = _side(count)
    tiles = plane.reshape(height // side, side, width // side, side).swapaxes(1, 2)
    out = np.empty((height // side, width // side, side * side), plane.dtype)
    out[:, :, _curve(side)] = tiles.reshape(*out.shape)
    return out.reshape(-1)[:count]


def _side(count: int) -> int:
    side = LEAST_TILE
    while side < TILE and side * side < count:
        side *= 2
    return side


@lru_cache(maxsize=8)
def _curve(side: int) -> NDArray:
    """(side²,) place in the list of every pixel of a tile, row by row: bits of column and row alternate."""
    rows, columns = np.divmod(np.arange(side * side), side)
    place = np.zeros(side * side, np.int64)
    for bit in range(side.bit_length() - 1):
        place |= ((columns >> bit) & 1) << (2 * bit) | ((rows >> bit) & 1) << (2 * bit + 1)
    return place
