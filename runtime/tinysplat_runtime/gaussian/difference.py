"""How far the attributes of one set of Gaussians are from those of another."""

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .gaussians import FIELDS, Gaussians
from .sh import resized_sh

_AT_A_TIME = 1 << 18


def attribute_errors(original: Gaussians, decoded: Gaussians) -> dict[str, dict[str, float]]:
    """Root mean square and largest error of every attribute over all layers, in world units.

    Means and scales are in scene units, opacities and SH coefficients as they are, and `quats` stands for the angle
    between two rotations in degrees. SH coefficients that `decoded` left out count as zeros.

    Args:
        original: any number of layers.
        decoded: as many layers of the same shapes.

    Returns:
        {attribute: {"rmse", "max"}}.

    Raises:
        InputError: layers or shapes differ.
    """
    sums = {name: [0.0, 0.0, 0] for name in FIELDS}  # sum of squares, largest, count
    for a, b in layer_pairs(original, decoded):
        for name in FIELDS:
            x, y = a.listed(name), b.listed(name)
            shift = b.origin - a.origin if name == "means" else np.zeros(())
            for error in _differences(x, y, shift, _angles if name == "quats" else _padded_difference):
                total, largest, count = sums[name]
                sums[name] = [
                    total + float(np.square(error).sum()),
                    max(largest, float(np.abs(error).max())),
                    count + error.size,
                ]
    return {name: {"rmse": math.sqrt(total / count), "max": largest} for name, (total, largest, count) in sums.items()}


def _differences(
    x: NDArray, y: NDArray, shift: NDArray, difference: Callable[[NDArray, NDArray], NDArray]
) -> Iterator[NDArray]:
    """Of arrays (N, …), so many at a time that float64 takes little memory."""
    for first in range(0, len(x), _AT_A_TIME):
        block = slice(first, first + _AT_A_TIME)
        yield difference(x[block].astype(np.float64), y[block].astype(np.float64) + shift)


def layer_pairs(original: Gaussians, decoded: Gaussians) -> list[tuple[Gaussians, Gaussians]]:
    """Layers that stand for each other; InputError if their shapes differ."""
    shapes = [[layer.opacities.shape for layer in g.layers] for g in (original, decoded)]
    if shapes[0] != shapes[1]:
        raise InputError(f"layers of shapes {shapes[1]}, expected {shapes[0]}", where="gaussians")
    return list(zip(original.layers, decoded.layers, strict=True))


def _angles(a: NDArray, b: NDArray) -> NDArray:
    """Angle in degrees between rotations (…, 4) of any length and sign; exact near zero, where arccos is not."""
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    b = b * np.where((a * b).sum(axis=-1, keepdims=True) < 0, -1, 1)
    apart, together = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return np.degrees(4 * np.arctan2(apart, together))


def _padded_difference(a: NDArray, b: NDArray) -> NDArray:
    return a - (b if a.shape == b.shape else resized_sh(b, a.shape[-2]))
