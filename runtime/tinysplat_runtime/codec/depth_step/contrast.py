"""Where an error of depth shows: colour contrast between neighbours.

A Gaussian that is moved, or changes places with its neighbour, is seen by as much as the two differ. On five scenes of
three kinds, the opacity-weighted contrast of 16 × 16 blocks went with the picture error that depth's coding error made
of them at a correlation of 0.7 to 0.9 (of logarithms), 0.4 on six views that hide one another.

Two things follow: what a few stripes of a picture say can be carried over to all of it (`probe`), and blocks without
contrast can be coded more coarsely than others (`block_offsets`).
"""

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians
from ...gaussian.planes import QP_BLOCK, qp_block_side
from ...gaussian.sh import C0
from ...system import disk

LARGEST_OFFSET = 8
"""Most that a block's QP differs from the plane's: steps of 0.4 to 2.5 times the plane's."""

_QP_PER_OCTAVE = 4.0
"""QPs by which a block of half the contrast is coarser. Equal slope would have 4.8: damage grows about as step^1.25."""

_FLOOR = 0.4
"""Contrast that every block has at least, in means of the layer: what lies behind may differ from what is in front."""

_TINY = 1e-20

_ROWS = 64
"""Rows looked at at a time: little memory, and what a processor's cache holds."""


def contrast(layer: Gaussians) -> NDArray:
    """Squared differences of degree-0 colours, as far as they can be seen, to the right and lower neighbour, times
    squared opacity: (V, H, W) float32, finite.
    """
    found = disk.zeros(layer.opacities.shape)
    arrays = (found, layer.sh, layer.opacities)
    for of_view, sh, opacities in zip(*arrays, strict=True):
        of_view[:] = 0
        for first in range(0, len(sh), _ROWS):
            colors = sh[first : first + _ROWS + 1, :, 0] * np.float32(C0)
            np.fmax(np.fmin(colors, 0.5, out=colors), -0.5, out=colors)  # 0 to 1 less a half, NaN as 1
            here, below = colors[:_ROWS], np.square(colors[1:] - colors[:-1]).sum(axis=-1)
            of_view[first : first + _ROWS, :-1] = np.square(here[:, 1:] - here[:, :-1]).sum(axis=-1)
            of_view[first : first + len(below)] += below
        of_view *= np.square(opacities)
    return found


def block_offsets(shown: NDArray) -> NDArray:
    """QP offsets by blocks of `QP_BLOCK` pixels, coarser where less is shown.

    Args:
        shown: (V, H, W) `contrast`.

    Returns:
        (V, ceil(H / 16), ceil(W / 16)) int8, of mean about 0.
    """
    _, height, width = shown.shape
    side = qp_block_side(height, width)
    means = np.stack([_block_means(of_view, side) for of_view in shown])
    octaves = np.log2(means + _FLOOR * means.mean() + _TINY)
    offsets = np.rint(_QP_PER_OCTAVE * (octaves.mean() - octaves))
    offsets = np.clip(offsets, -LARGEST_OFFSET, LARGEST_OFFSET).astype(np.int8)
    repeat = side // QP_BLOCK
    whole = offsets.repeat(repeat, axis=1).repeat(repeat, axis=2)
    return whole[:, : -(-height // QP_BLOCK), : -(-width // QP_BLOCK)]


def _block_means(shown: NDArray, side: int) -> NDArray:
    """Float64 means of an array (H, W) over blocks of that side."""
    height, width = shown.shape
    padded = np.pad(shown, ((0, -height % side), (0, -width % side)), mode="edge")
    return padded.reshape(-1, side, padded.shape[1] // side, side).mean(axis=(1, 3), dtype=np.float64)
