"""A stand-in for the video codec that costs milliseconds: 8 × 8 DCT and a dead zone.

What a quantiser step would do to a plane has to be known before any plane is coded. An orthonormal DCT with the codec's
dead zone makes errors of about its size and shape: a smooth plane loses nothing, a textured one its detail.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...gaussian.planes import QP_BLOCK

SIDE = 8
DEAD_ZONE = 1 / 3
"""Coefficients are rounded down from this much above a whole step, as rate-distortion optimised coders do."""


def _dct_matrix() -> NDArray:
    k, n = np.mgrid[:SIDE, :SIDE]
    rows = np.cos(math.pi * (2 * n + 1) * k / (2 * SIDE)) * math.sqrt(2 / SIDE)
    rows[0] /= math.sqrt(2)
    return rows.astype(np.float32)


DCT = _dct_matrix()


def dct(blocks: NDArray, matrix: NDArray = DCT) -> NDArray:
    """The DCT of blocks (8, 8, n) float32 along their first two axes; with its transpose, the inverse."""
    return np.einsum("li,kin->kln", matrix, np.einsum("kj,jin->kin", matrix, blocks))


def whole_steps(scaled: NDArray) -> NDArray:
    """Numbers of steps, float of any shape, as whole ones that the codec might choose."""
    return np.sign(scaled) * np.floor(np.abs(scaled) + DEAD_ZONE)


@dataclass(frozen=True, eq=False)
class BlockSpectrum:
    """DCT coefficients of 8 × 8 blocks of planes (V, H, W), which are padded to whole blocks by repetition.

    Attributes:
        coefficients: (8, 8, n) float32, frequencies first.
        at: view, block row and block column of each block, three arrays (n,).
        shape: V, H, W.
    """

    coefficients: NDArray
    at: tuple[NDArray, ...]
    shape: tuple[int, ...]

    @classmethod
    def of(cls, planes: NDArray, chosen: NDArray | None = None) -> BlockSpectrum:
        """Transform planes (V, H, W) float32, or those of their blocks that `chosen` (V, H/8, W/8) names."""
        views, height, width = planes.shape
        grid = (views, -(-height // SIDE), -(-width // SIDE))
        at = np.nonzero(np.ones(grid, bool) if chosen is None else chosen)
        rows, columns = (SIDE * first + np.arange(SIDE)[:, None] for first in at[1:])  # (8, n) each
        rows, columns = np.minimum(rows, height - 1)[:, None], np.minimum(columns, width - 1)
        return cls(dct(planes[at[0], rows, columns]), at, planes.shape)

    def coding_error(self, step: float, offsets: NDArray | None = None) -> NDArray:
        """(V, H, W) float32 that quantisation at `step` would add to the planes; 0 outside the blocks.

        Args:
            step: in the planes' units.
            offsets: (V, ceil(H / 16), ceil(W / 16)) QPs by which blocks of `QP_BLOCK` pixels are coarser.
        """
        steps: NDArray = np.full(1, step, np.float32)
        if offsets is not None:
            view, row, column = self.at
            share = SIDE / QP_BLOCK
            by_block = offsets[view, (row * share).astype(int), (column * share).astype(int)]
            steps = steps * np.exp2(by_block.astype(np.float32) / 6)
        scaled = self.coefficients / steps
        views, height, width = self.shape
        error = np.zeros((views, -(-height // SIDE), SIDE, -(-width // SIDE), SIDE), np.float32)
        rounding = dct((whole_steps(scaled) - scaled) * steps, DCT.T)
        error[self.at[0], self.at[1], :, self.at[2]] = np.moveaxis(rounding, -1, 0)
        whole = error.reshape(views, error.shape[1] * SIDE, error.shape[3] * SIDE)
        return whole[:, :height, :width]
