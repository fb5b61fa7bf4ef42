"""One exposure over a capture: a gain and an offset per photo and channel, by what overlapping photos show.

What `tinysplat.networks.exposure` computes for the photos of one call, of pairs whose colours a graph has compared.
Every pair tells the ratio of gains and the difference of offsets where it matches. Photos about which that says little
stay as they are, so that far ones, which no pair joins, need not agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

OUTLIER, ROUNDS = 0.06, 3
"""Colour difference, after correction, from which a cell's weight falls, and rounds of estimating with such weights."""

LEVEL_WEIGHT, LARGEST = 0.3, 1.2
"""Weight of the squared mean beside the variance in a gain, and bound on a gain's logarithm."""

STILL = 0.005
"""Weight of no change, as a share of matching cells."""

LEAST_SHOWN, LEAST_MATCHED = 0.18, 0.02
"""Logarithm of a gain, and offset, of which half stays: in colours to show, and to match with."""

SWEEPS = 400
"""Steps in which values spread from photo to photo; what no change weighs stops them long before."""


@dataclass(frozen=True)
class Pair:
    """What two photos show at the same places.

    Attributes:
        reference, source: their indices.
        here, there: (n, 3) colours of cells of the first, and of the second at their places.
        sound: (n,) how sure that is.
        cells: how many a photo has, of which those that tell nothing are left out.
    """

    reference: int
    source: int
    here: NDArray
    there: NDArray
    sound: NDArray
    cells: int


@dataclass(frozen=True)
class Exposures:
    """Gains and offsets (V, 3) float32, to match photos with and to show them in."""

    gain: NDArray
    offset: NDArray
    shown_gain: NDArray
    shown_offset: NDArray

    def matched(self, photo: NDArray, view: int) -> NDArray:
        """A photo (…, 3, H, W) float32 to match with."""
        return _exposed(photo, self.gain[view], self.offset[view])

    def shown(self, photo: NDArray, view: int) -> NDArray:
        """A photo (…, 3, H, W) float32 to take colours from."""
        return _exposed(photo, self.shown_gain[view], self.shown_offset[view])


def one_exposure(pairs: Sequence[Pair], nearest: Sequence[Sequence[int]]) -> Exposures:
    """Exposures of photos, the first of which stays as it is to match with.

    Args:
        pairs: all that were compared.
        nearest: for each photo its nearest partners, of which the first two count.
    """
    weights = [pair.sound for pair in pairs]
    for _ in range(ROUNDS):
        gain, offset = _solved(pairs, weights, nearest, LEAST_MATCHED, odd=False)
        weights = [_trusted(pair, gain, offset) for pair in pairs]
    matched = _solved(pairs, weights, nearest, LEAST_MATCHED, odd=False)
    shown = _solved(pairs, weights, nearest, LEAST_SHOWN, odd=True)
    return Exposures(*(values.astype(np.float32) for values in (*matched, *shown)))


def _trusted(pair: Pair, gain: NDArray, offset: NDArray) -> NDArray:
    here = gain[pair.reference] * pair.here + offset[pair.reference]
    rest = here - gain[pair.source] * pair.there - offset[pair.source]
    return pair.sound / (1 + np.square(rest).mean(axis=1) / OUTLIER**2)


def _solved(
    pairs: Sequence[Pair], weights: Sequence[NDArray], nearest: Sequence[Sequence[int]], least: float, *, odd: bool
) -> tuple[NDArray, NDArray]:
    """Gains and offsets (V, 3) with those weights."""
    evidence = np.array([weight.sum() / pair.cells for pair, weight in zip(pairs, weights, strict=True)])
    means, spreads = np.empty((2, len(pairs), 3)), np.empty((2, len(pairs), 3))
    for n, (pair, weight) in enumerate(zip(pairs, weights, strict=True)):
        mass = max(float(weight.sum()), 1e-6)
        for side, colours in enumerate((pair.here, pair.there)):
            mean = means[side, n] = (colours * weight[:, None]).sum(axis=0) / mass
            variance = (np.square(colours - mean) * weight[:, None]).sum(axis=0) / mass
            spreads[side, n] = variance + LEVEL_WEIGHT * np.square(mean) + 1e-4
    reference, source = (np.array([getattr(pair, name) for pair in pairs]) for name in ("reference", "source"))

    def settled(difference: NDArray) -> NDArray:
        values = _agreed(evidence, difference, reference, source, len(nearest))
        return _above_noise(_odd(values, nearest) if odd else values, least)

    gain = np.exp(settled(0.5 * np.log(spreads[1] / spreads[0])).clip(-LARGEST, LARGEST))
    return gain, settled(gain[source] * means[1] - gain[reference] * means[0])


def _agreed(evidence: NDArray, difference: NDArray, reference: NDArray, source: NDArray, views: int) -> NDArray:
    """Values a (V, 3) with a[reference] − a[source] = difference (P, 3), the first photo's zero.

    Weighted least squares with a pull to zero, by steps that each take sums over pairs: no result depends on a library
    of linear algebra.
    """
    ends, others = np.concatenate([reference, source]), np.concatenate([source, reference])
    weights = np.concatenate([evidence, evidence])
    wanted = np.concatenate([difference, -difference])
    diagonal = np.bincount(ends, weights, views) + STILL
    terms = np.zeros((views, 3))
    for _ in range(SWEEPS):
        pulls = weights[:, None] * (terms[others] + wanted)
        after = np.stack([np.bincount(ends, pulls[:, c], views) for c in range(3)], axis=1) / diagonal[:, None]
        after[0] = 0
        if np.abs(after - terms).max() < 1e-7:
            break
        terms = after
    return terms


def _odd(values: NDArray, nearest: Sequence[Sequence[int]]) -> NDArray:
    """What is a photo's own in values (V, 3): less the median of it and its two nearest."""
    near = np.stack([values[[*partners[:2], *partners[:2]][:2]] for partners in nearest])  # one partner counts twice
    return values - values.clip(near.min(axis=1), near.max(axis=1))


def _above_noise(values: NDArray, least: float) -> NDArray:
    """What is well above `least` as it is, what is well below as nothing, without a step between."""
    power = values**4
    return values * power / (power + least**4)


def _exposed(photo: NDArray, gain: NDArray, offset: NDArray) -> NDArray:
    return (photo * gain[:, None, None] + offset[:, None, None]).clip(0, 1)
