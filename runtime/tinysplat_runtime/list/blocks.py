"""Blocks of space that a large list is looked at in, one after the other: memory and the sharpness of what is seen stay
those of a block, however many there are.

A block is looked at alone. What would hide some of it, or stand behind it, is then not there: more of it counts as seen
than is, which keeps more.
"""

import numpy as np
from numpy.typing import NDArray

from .views import TOGETHER


def blocks_of(means: NDArray, most: int = TOGETHER) -> list[NDArray]:
    """Rows (n,) int32, rising, of each block of at most so many of (N, 3) means.

    Parts of parts, cut across their longest side, until all are small enough and about as large.
    """
    blocks, found = [np.arange(len(means), dtype=np.int32)], []
    while blocks:
        rows = blocks.pop()
        if len(rows) <= most:
            found.append(rows)
            continue
        here, parts = means[rows], -(-len(rows) // most)
        low, high = np.percentile(here, (5, 95), axis=0)
        order = np.argsort(here[:, np.argmax(high - low)], kind="stable")
        cut = len(order) * (parts // 2) // parts
        blocks += [np.sort(rows[part]) for part in (order[cut:], order[:cut])]
    return found
