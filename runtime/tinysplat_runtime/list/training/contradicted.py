"""What of a photo the others contradict: something that moved or changed between them, which no scene has.

What is trained on all photos shows what most of them have. Where one stays far from it over whole blocks of pixels, it
shows something else, and nothing is learnt from it there. Neighbours count, as of what moved some has by chance the
colours of what it covers (after RobustNeRF, arXiv 2302.00833). Gloss and what is too fine to be shown differ, too, but
in most photos alike: so only those count that differ much more than most.
"""

import numpy as np
from numpy.typing import NDArray

from ...render.kernels_gradient import BLOCK
from .contrast import smoothed

BESIDE = 0.5
"""Share of the error that contradicts, from which on a block beside one that is contradicted is so too."""

LEAST_SHARE, TIMES_MEDIAN = 0.04, 10.0
"""Share of a photo's blocks, and times that of most photos, from which on it is believed that they are contradicted."""


def contradicted(wrong: NDArray, least: float) -> list[NDArray]:
    """By photo, (rows, columns) bool of blocks of 8×8 pixels: whether |error| (V, H, W), of all colours, is on the mean
    above `least`, or not far below it beside such a block.
    """
    found = [_blocks(own, least) for own in wrong]
    shares = [own.mean() for own in found]
    much = max(LEAST_SHARE, TIMES_MEDIAN * float(np.median(shares)))
    return [own & (share >= much) for own, share in zip(found, shares, strict=True)]


def _blocks(wrong: NDArray, least: float) -> NDArray:
    starts = [range(0, size, BLOCK) for size in wrong.shape]
    sums = np.add.reduceat(np.add.reduceat(wrong, starts[0], axis=0), starts[1], axis=1)
    means = sums / np.outer(*(np.diff([*at, size]) for at, size in zip(starts, wrong.shape, strict=True)))
    found = means > least
    return found | ((smoothed(found.astype(np.float32)) > 0) & (means > BESIDE * least))


def pixels(blocks: NDArray, shape: tuple[int, ...], smaller: int = 1) -> NDArray:
    """(H, W) bool, which pixels of a photo of a shape (H, W, …) lie in blocks; the photo may be so many times smaller
    than that of which they are.
    """
    rows, columns = (np.arange(size) * smaller // BLOCK for size in shape[:2])
    return blocks[np.ix_(rows, columns)]
