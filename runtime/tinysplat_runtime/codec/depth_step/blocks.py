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
    """The DCT of blocks (n, H/8, 8, W/8, 8) along their axes of length 8; with its transpose, the inverse."""
    down = np.einsum("kj,nhjwi->nhkwi", matrix, blocks)
    # Blocks side by side for the other axis: a last axis of 8 would be eight times as slow.
    across = np.ascontiguousarray(np.moveaxis(down, -1, 0))
    return np.moveaxis(np.einsum("kj,jnhiw->knhiw", matrix, across), 0, -1)


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
        blocks = padded.reshape(count, padded.shape[1] // SIDE, SIDE, -1, SIDE)
        return cls(dct(blocks), (height, width))

    def coding_error(self, step: float, offsets: NDArray | None = None) -> NDArray:
        """(n, H, W) what quantisation at `step` would add to the planes.

        Args:
            step: in the planes' units.
            offsets: (n, ceil(H / 16), ceil(W / 16)) QPs by which blocks of `QP_BLOCK` pixels are coarser.
        """
        steps: NDArray = np.full((1, 1, 1, 1, 1), step, np.float32)
        if offsets is not None:
            repeat = QP_BLOCK // SIDE
            _, rows, _, columns, _ = self.coefficients.shape
            by_block = np.exp2(offsets.astype(np.float32) / 6).repeat(repeat, axis=1).repeat(repeat, axis=2)
            steps = steps * by_block[:, :rows, None, :columns, None]
        scaled = self.coefficients / steps
        levels = np.sign(scaled) * np.floor(np.abs(scaled) + np.float32(DEAD_ZONE))
        error = (levels - scaled) * steps
        count, rows, _, columns, _ = error.shape
        planes = dct(error, DCT.T).reshape(count, rows * SIDE, columns * SIDE)
        return planes[:, : self.size[0], : self.size[1]]
