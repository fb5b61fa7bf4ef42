"""A stand-in for the video codec that costs milliseconds: 8 × 8 DCT, a dead zone, and a guess at the bits.

What a quantiser step would do to a plane has to be known before any plane is coded. An orthonormal DCT with the codec's
dead zone makes errors of about its size and shape (a smooth plane loses nothing, a textured one its detail), and the
logarithms of the coefficients rank planes by what a finer step would cost. Neither is exact, nor needs to be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SIDE = 8
DEAD_ZONE = 1 / 3
"""Coefficients are rounded down from this much above a whole step, as rate-distortion optimised coders do."""

_THRESHOLD, _FIRST_OCTAVES, _BITS_PER_OCTAVE = 0.6, 1.5, 1.2

_LEAST_EXPONENT, _EXPONENTS, _PER_OCTAVE = -40, 80, 2
"""The histogram of log2 |coefficient|: first octave, octaves, bins per octave."""


def _dct_matrix() -> NDArray:
    k, n = np.mgrid[:SIDE, :SIDE]
    rows = np.cos(math.pi * (2 * n + 1) * k / (2 * SIDE)) * math.sqrt(2 / SIDE)
    rows[0] /= math.sqrt(2)
    return rows.astype(np.float32)


DCT = _dct_matrix()


@dataclass(frozen=True, eq=False)
class BlockSpectrum:
    """DCT coefficients of planes (n, H, W), padded to whole blocks by repetition.

    Attributes:
        coefficients: (n, H/8, 8, W/8, 8) float32, frequencies on the axes of length 8.
        size: H, W before padding.
    """

    coefficients: NDArray
    size: tuple[int, int]

    @classmethod
    def of(cls, planes: NDArray) -> BlockSpectrum:
        """Transform planes (n, H, W) float32."""
        count, height, width = planes.shape
        pad = ((0, 0), (0, -height % SIDE), (0, -width % SIDE))
        padded = np.pad(planes, pad, mode="edge") if any(side for _, side in pad) else planes
        rows = padded.reshape(count, -1, SIDE) @ DCT.T
        blocks = rows.reshape(count, padded.shape[1] // SIDE, SIDE, padded.shape[2])
        return cls((DCT @ blocks).reshape(*blocks.shape[:3], -1, SIDE), (height, width))

    def coding_error(self, step: float) -> NDArray:
        """(n, H, W) what quantisation at `step` would add to the planes."""
        scaled = self.coefficients * np.float32(1 / step)
        levels = np.sign(scaled) * np.floor(np.abs(scaled) + np.float32(DEAD_ZONE))
        error = (levels - scaled) * np.float32(step)
        count, rows, _, columns, _ = error.shape
        blocks = DCT.T @ error.reshape(count, rows, SIDE, columns * SIDE)
        planes = (blocks.reshape(-1, SIDE) @ DCT).reshape(count, rows * SIDE, columns * SIDE)
        return planes[:, : self.size[0], : self.size[1]]

    def bits(self, steps: NDArray) -> NDArray:
        """(s,) rough bits of the planes at `steps` (s,).

        Σ 1.2·(1.5 + log2(c/τ)) over coefficients above τ = 0.6 Δ. Fitted to libx265: a coefficient costs its sign and
        place once it is coded at all, then its magnitude. DC counts as the difference to the block on the left.
        """
        c = self.coefficients
        dc = np.diff(c[:, :, 0, :, 0], axis=2)
        counts = _histogram(c) - _histogram(c[:, :, 0, :, 0]) + _histogram(dc)
        octaves = _LEAST_EXPONENT + (np.arange(len(counts)) + 0.5) / _PER_OCTAVE
        above = octaves - np.log2(_THRESHOLD * np.asarray(steps))[:, None]  # (s, bins)
        return np.where(above > 0, _BITS_PER_OCTAVE * (_FIRST_OCTAVES + above), 0) @ counts


def _histogram(values: NDArray) -> NDArray:
    """Counts of log2 |v|; zeros fall into the first bin, which costs nothing at any step."""
    bins = np.log2(np.maximum(np.abs(values).ravel(), np.float32(2.0**_LEAST_EXPONENT)))
    index = ((bins - _LEAST_EXPONENT) * _PER_OCTAVE).astype(np.int64)
    return np.bincount(np.minimum(index, _EXPONENTS * _PER_OCTAVE - 1), minlength=_EXPONENTS * _PER_OCTAVE)
