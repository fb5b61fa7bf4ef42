"""What a step takes besides pictures, as compiled code: neighbours in planes, and Adam."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..system.kernels_compile import Number, compiled

_F = np.float32


@compiled
def add_bits(plane: NDArray, price: Number, out: NDArray) -> None:
    """Add the gradient of what coding a plane costs: price · Σ ½ log2(1 + d²) over neighbours' differences d.

    Small differences cost their square, large ones hardly more than they did: noise falls, edges stay.

    Args:
        plane: (H, W) float32 in quantiser steps.
        price: of a bit.
        out: (H, W) float32, added to; with respect to `plane`.
    """
    height, width = plane.shape
    factor = _F(price / math.log(2))
    for row in range(height):
        for column in range(width):
            if column + 1 < width:
                d = plane[row, column] - plane[row, column + 1]
                slope = factor * d / (_F(1) + d * d)
                out[row, column] += slope
                out[row, column + 1] -= slope
            if row + 1 < height:
                d = plane[row, column] - plane[row + 1, column]
                slope = factor * d / (_F(1) + d * d)
                out[row, column] += slope
                out[row + 1, column] -= slope


@compiled
def add_variation(change: NDArray, across: NDArray, down: NDArray, weight: Number, out: NDArray) -> None:
    """Add the gradient of weight · Σ √(d² + ε²) over neighbours' differences d, by their own weights.

    Args:
        change: (H, W) float32.
        across, down: (H, W) float32 weights of the pairs with the right and the lower neighbour.
        weight: of all.
        out: (H, W) float32, added to.
    """
    height, width = change.shape
    soft = _F(1e-6)  # (a thousandth of depth)²
    for row in range(height):
        for column in range(width):
            if column + 1 < width:
                d = change[row, column] - change[row, column + 1]
                slope = _F(weight) * across[row, column] * d / math.sqrt(d * d + soft)
                out[row, column] += slope
                out[row, column + 1] -= slope
            if row + 1 < height:
                d = change[row, column] - change[row + 1, column]
                slope = _F(weight) * down[row, column] * d / math.sqrt(d * d + soft)
                out[row, column] += slope
                out[row + 1, column] -= slope


@compiled
def adam(values: NDArray, gradient: NDArray, first: NDArray, second: NDArray, numbers: tuple[Number, ...]) -> None:
    """A step of Adam (Kingma & Ba 2015) on values of one kind.

    Args:
        values: (n,) float32, changed.
        gradient: (n,) float32, of this step.
        first, second: (n,) float32, running means of the gradient and its square, changed.
        numbers: step size, β₁, β₂, ε, how many steps there were with this one, least and greatest value.
    """
    size, beta_1, beta_2, epsilon, count, least, greatest = numbers
    rise_1, rise_2 = 1 - beta_1**count, 1 - beta_2**count
    for row in range(values.size):
        slope, value = np.float64(gradient[row]), np.float64(values[row])
        m = beta_1 * first[row] + (1 - beta_1) * slope
        v = beta_2 * second[row] + (1 - beta_2) * slope * slope
        first[row], second[row] = _F(m), _F(v)
        moved = value - size * (m / rise_1) / (math.sqrt(v / rise_2) + epsilon)
        values[row] = _F(min(max(moved, min(value, least)), max(value, greatest)))
