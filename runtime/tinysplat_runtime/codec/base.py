"""What a layer's codes are added to, in the forms that the synthesis adds up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_HALF_RANGE = 1 << 16


def as_codes(planes: NDArray) -> tuple[NDArray, NDArray]:
    """Float planes in the form that the synthesis graph adds up: 16-bit codes and what one is worth.

    Args:
        planes: (V, C, H, W) float32.

    Returns:
        codes (V, 2C, H, W) uint16, upper halves first, and mix (C, 2C + 1) float64: planes = mix · (codes, 1), to
        2⁻³² of each channel's range.
    """
    count = planes.shape[1]
    low = planes.min(axis=(0, 2, 3)).astype(np.float64)
    span = np.maximum(planes.max(axis=(0, 2, 3)) - low, 1e-30)
    unit = span / (_HALF_RANGE**2 - 1)
    steps = np.rint((planes - low[:, None, None]) / unit[:, None, None]).astype(np.uint32)
    codes = np.concatenate([steps >> 16, steps & (_HALF_RANGE - 1)], axis=1).astype(np.uint16)
    mix = np.zeros((count, 2 * count + 1))
    mix[:, :count] = np.diag(unit * _HALF_RANGE)
    mix[:, count:-1] = np.diag(unit)
    mix[:, -1] = low
    return codes, mix


def fitted_sh(sh: NDArray, shape: tuple[int, ...]) -> NDArray:
    """Coefficients (…, B', 3) as (…, B, 3) float32: cut, or filled with zeros."""
    count = min(sh.shape[-2], shape[-2])
    out = np.zeros((*sh.shape[:-2], shape[-2], 3), np.float32)
    out[..., :count, :] = sh[..., :count, :]
    return out
