"""Steps down a gradient, as compiled code."""

import math

import numpy as np
from numpy.typing import NDArray

from ...system.kernels_compile import Number, compiled

_F = np.float32


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
