"""Colours of a list as few numbers each: principal components of their SH coefficients, one basis for all tiers."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...codec.basis import leading_signs
from ...gaussian.planes import PlaneClass
from ...system.blas import product, symmetric_eigen
from .attributes import ROWS
from .steps import Steps

BRIGHTEST = 32.0
"""SH coefficients are cut at so many times the spread of all but a hundredth of them, or at this number if that is
more: what few exceed it would be white anyway, and take the first principal components from all others."""

FLAT_SHARE = 0.12
"""Standard deviation, in steps, below which a channel is stored as a number."""

COLOUR_SHARE = 0.25
"""The same below which a component of colour behind the third is left out: its column of the basis takes bytes too."""

_SAMPLE, _TOGETHER = 1 << 17, 8


@dataclass(frozen=True)
class Palette:
    """Principal components of colours.

    Attributes:
        mean: (d,) float32.
        basis: (d, k) float16.
        low, high: (d,) between which coefficients are cut.
        projection: (d, k) float64, to components.
    """

    mean: NDArray
    basis: NDArray
    low: NDArray
    high: NDArray
    projection: NDArray

    def components(self, sh: NDArray, rows: NDArray) -> Iterator[tuple[int, NDArray]]:
        """Of `rows` (n,) of coefficients (N, d) the number of a component, and from it on some (…, n) float64, till all
        are there.
        """
        for first in range(0, self.projection.shape[1], _TOGETHER):
            towards = np.ascontiguousarray(self.projection[:, first : first + _TOGETHER])
            out = np.empty((towards.shape[1], len(rows)))
            for start in range(0, len(rows), ROWS):
                part = slice(start, start + ROWS)
                own = sh[rows[part]].clip(self.low, self.high) - self.mean.astype(np.float64)
                out[:, part] = product(own, towards).T
            yield first, out


def principal_colours(sh: NDArray, rows: NDArray, gains: NDArray, steps: Steps) -> Palette:
    """Principal components of `rows` (n,) of (N, d) coefficients under the weights that errors show with; as many as
    hold more than nothing at their steps. `gains` are (n,).
    """
    every = -(-len(rows) // _SAMPLE)
    sample, weights = sh[rows[::every]].astype(np.float64), np.square(1 / gains[::every])
    middle = np.array([np.median(column) for column in sample.T])  # of all at once it takes a copy
    away = [np.percentile(np.abs(column - of), 99) for column, of in zip(sample.T, middle, strict=True)]
    most = BRIGHTEST * np.maximum(away, 1)
    low, high = middle - most, middle + most
    centred = sample.clip(low, high, out=sample)
    mean = (np.einsum("nd,n->d", sample, weights) / weights.sum()).astype(np.float32)
    centred -= mean
    moment = product((centred * weights[:, None]).T, centred) / len(sample)
    values, vectors = symmetric_eigen(moment)
    numbers = range(len(values))
    least = np.array([steps.of(PlaneClass.COLOR, n) * (FLAT_SHARE if n < 3 else COLOUR_SHARE) for n in numbers])
    k = int((np.sqrt(np.maximum(values[::-1], 0)) > least).sum())
    chosen = vectors[:, ::-1][:, :k]
    basis = (chosen * leading_signs(chosen)).astype(np.float16)
    wide = basis.astype(np.float64)
    projection = np.linalg.solve(product(wide.T, wide), wide.T).T if k else wide
    return Palette(mean, basis, low, high, projection)
