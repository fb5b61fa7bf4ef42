"""What goes is not lost where something like it stays: two Gaussians become one of both's mass, mean and covariance.

Merging pairs until few are left is NanoGS' idea. Here removal says which Gaussians stay, and only what goes is merged.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...gaussian.curve import morton_keys
from ...gaussian.gaussians import Gaussians
from ...gaussian.quaternions import matrices_to_quats, normalize_quats, quats_to_matrices
from ...gaussian.sh import C0
from ...system.blas import symmetric_eigen
from ...system.kernels_compile import Number, compiled, within

UNLIKE = 0.6
"""Bhattacharyya's distance of two Gaussians plus |Δr| + |Δg| + |Δb|, from which they are not merged."""

WINDOW = 6
"""Neighbours before and after along a curve through space that are looked at, and as many along another."""

THINNEST = 1e-3
"""Of a Gaussian's largest scale: thinner ones count as so thick."""

FULLEST = 0.999

_BITS, _SHIFTS = 20, (0.0, 0.37)


def merged(gaussians: Gaussians, kept: NDArray, gone: NDArray) -> Gaussians:
    """Rows `kept` of (N,) Gaussians, in this order, and with them those of `gone` that are like one of them.

    A Gaussian's mass is its opacity times its mean area; SH are averaged by it.
    """
    scales = gaussians.scales.astype(np.float64)
    scales = np.maximum(scales, np.maximum(THINNEST * scales.max(axis=1, keepdims=True), 1e-15))
    axes = quats_to_matrices(normalize_quats(gaussians.quats.astype(np.float64))) * scales[:, None]
    covariances, means = axes @ axes.swapaxes(1, 2), gaussians.means.astype(np.float64)
    areas = np.prod(scales, axis=1) ** (2 / 3)
    into = np.full(len(gone), -1)
    looks = Looks(means, covariances, np.log(scales).sum(axis=1), C0 * gaussians.sh[:, 0].astype(np.float64))
    for near in _neighbours(means, kept, gone):
        choose(looks, gone, near, UNLIKE, into)
    rows = np.concatenate([kept, gone[into >= 0]])
    to = np.concatenate([np.arange(len(kept)), np.searchsorted(kept, into[into >= 0])])
    mass = gaussians.opacities[rows] * areas[rows]
    total = np.bincount(to, mass)

    def mean(values: NDArray) -> NDArray:
        flat = values.reshape(len(rows), -1)
        sums = [np.bincount(to, mass * flat[:, column]) for column in range(flat.shape[1])]
        return (np.stack(sums, axis=1) / total[:, None]).reshape(len(kept), *values.shape[1:])

    middles = mean(means[rows])
    away = means[rows] - middles[to]
    is_more = np.bincount(to) > 1
    lengths, turns = principal_axes(mean(covariances[rows] + away[:, :, None] * away[:, None])[is_more])
    opacities = np.minimum(total[is_more] / np.prod(lengths, axis=1) ** (2 / 3), FULLEST)
    of_both = {"means": middles[is_more], "scales": lengths, "quats": turns, "opacities": opacities}
    of_both["sh"] = mean(gaussians.sh[rows])[is_more]
    fields = {name: getattr(gaussians, name)[kept] for name in of_both}
    for name, values in of_both.items():
        fields[name][is_more] = values
    return Gaussians.unchecked(
        **fields, origin=gaussians.origin, notes=gaussians.notes, viewpoints=gaussians.viewpoints
    )


def _neighbours(means: NDArray, kept: NDArray, gone: NDArray) -> Iterator[NDArray]:
    """(n,) rows of `kept` near each of `gone`, one candidate at a time."""
    low, high = np.percentile(means, (1, 99), axis=0)
    unit = (1 << _BITS) / (2 * float((high - low).max()) or 1.0)
    for shift in _SHIFTS:
        cells = ((means - low) * unit + (shift + 0.5) * (1 << (_BITS - 1))).clip(0, (1 << _BITS) - 1)
        keys = morton_keys(cells.astype(np.int64))
        order = np.argsort(keys[kept], kind="stable")
        places = np.searchsorted(keys[kept][order], keys[gone])
        for step in range(-WINDOW, WINDOW):
            yield kept[order[(places + step).clip(0, len(kept) - 1)]]


def principal_axes(covariances: NDArray) -> tuple[NDArray, NDArray]:
    """(n, 3) standard deviations and (n, 4) unit quaternions of symmetric matrices (n, 3, 3), float64."""
    values, vectors = symmetric_eigen(covariances)
    vectors[:, :, 2] *= np.sign(np.linalg.det(vectors))[:, None]
    return np.sqrt(np.maximum(values, 1e-30)), matrices_to_quats(vectors)


class Looks(NamedTuple):
    """What likeness is judged by.

    Attributes:
        means, covariances, colours: (N, 3), (N, 3, 3), (N, 3) float64.
        logs: (N,) of the square roots of determinants.
    """

    means: NDArray
    covariances: NDArray
    logs: NDArray
    colours: NDArray


@compiled
def choose(looks: Looks, gone: NDArray, near: NDArray, most: Number, into: NDArray) -> None:
    """Take the candidate where it is liker than what was taken before.

    Args:
        looks: of all.
        gone, near: (n,) rows.
        most: the distance from which nothing is taken.
        into: (n,) rows taken, −1 for none; changed.
    """
    for number in range(gone.size):
        own = gone[number]
        found = _unlikeness(looks, own, near[number])
        before = into[number]
        if found < most and (before < 0 or found < _unlikeness(looks, own, before)):
            into[number] = near[number]


@within
def _unlikeness(looks: Looks, one: Number, other: Number) -> Number:
    means, covariances, logs, colours = looks
    a = 0.5 * (covariances[one] + covariances[other])
    x, y, z = means[one, 0] - means[other, 0], means[one, 1] - means[other, 1], means[one, 2] - means[other, 2]
    p, s, u = a[1, 1] * a[2, 2] - a[1, 2] ** 2, a[0, 0] * a[2, 2] - a[0, 2] ** 2, a[0, 0] * a[1, 1] - a[0, 1] ** 2
    q, r = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2], a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    t = a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]
    det = a[0, 0] * p + a[0, 1] * q + a[0, 2] * r
    if not det > 0:
        return np.inf
    square = (p * x * x + s * y * y + u * z * z + 2 * (q * x * y + r * x * z + t * y * z)) / det
    colour = 0.0
    for channel in range(3):
        colour += abs(colours[one, channel] - colours[other, channel])
    return square / 8 + 0.5 * (math.log(det) - logs[one] - logs[other]) + colour
