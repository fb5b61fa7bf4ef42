"""How large Gaussians are in each part of a scene, and whether that differs from part to part.

Gaussians are about as large as pixels of the photos that they were made from. About an object cameras are equally far
from all of it; in a place, which was seen from within, they are near some of it and far from the rest, and sizes differ
by as much. What rounding shows goes with these sizes too.
"""

import numpy as np
from numpy.typing import NDArray

from ..gaussian.curve import morton_keys
from ..gaussian.gaussians import Gaussians

UNEVEN = 3.5
"""Octaves between sizes of Gaussians in the finest and the coarsest parts of a scene: of a place, so many or more. Nine
trained objects have 1.1 to 3.0, captured places 5.7 to 7.2.
"""

ALIKE = 64
"""Gaussians in a row along a curve through space that are a part."""

_BITS = 20


def sizes_about(gaussians: Gaussians) -> NDArray:
    """(N,) float64, the median size of the part that each Gaussian lies in: of both larger scales' geometric means."""
    means = gaussians.means.astype(np.float64)
    low, high = np.percentile(means, (1, 99), axis=0)
    unit = (1 << _BITS) / (2 * float((high - low).max()) or 1.0)
    cells = ((means - low) * unit + (1 << (_BITS - 2))).clip(0, (1 << _BITS) - 1)
    order = np.argsort(morton_keys(cells.astype(np.int64)), kind="stable")
    widths = np.sort(gaussians.scales, axis=1)[order, 1:].astype(np.float64)
    logs = np.log(np.maximum(widths, 1e-15)).mean(axis=1)
    parts = np.array_split(logs, max(len(logs) // ALIKE, 1))
    sizes = np.empty(len(logs))
    sizes[order] = np.exp(np.repeat([np.median(part) for part in parts], [len(part) for part in parts]))
    return sizes


def is_uneven(sizes: NDArray) -> bool:
    """Whether sizes about Gaussians, (N,) float64, are those of a place."""
    finest, coarsest = np.percentile(sizes, (5, 95))
    return bool(np.log2(coarsest / finest) >= UNEVEN)
