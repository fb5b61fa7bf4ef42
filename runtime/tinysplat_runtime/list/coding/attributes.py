"""A list as channels, and back: the maps of docs/FORMAT.md, section 4, "Lists".

All arithmetic is float64.

A Gaussian's axes can be named in 24 ways that look alike. The longest comes first and the rotation is the smallest of
the four that are left, so that scales and rotations repeat less of each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ...container.list import MAX_EXPONENT
from ...gaussian.gaussians import Gaussians
from ...gaussian.quaternions import matrices_to_quats, multiply_quats, normalize_quats, quats_to_matrices

ROWS = 1 << 16
"""Gaussians that are worked on at a time: in float64 they take several times as much as they do themselves."""

LEAST_SCALE = 2e-30
MAX_RATIO = 14.0
"""Largest logarithm of a ratio of scales that is coded: beyond a million to one nothing thinner shows."""

KNEE = 2 * math.log(8)
"""Distance from the middle size, in logarithms, between which steps follow the square root of a size."""

_HALF_TURNS = np.eye(4)
"""The identity, and half turns about the three axes: what a Gaussian does not change under."""


@dataclass(frozen=True)
class Columns:
    """Gaussians as the channels that are coded, but for colours; N rows.

    Attributes:
        roots: (N,) √opacity.
        sizes: (N,) logarithm of the geometric mean of the two larger scales.
        lengths: (N,) logarithm of the largest over the second scale, ≥ 0.
        thins: (N,) logarithm of the second over the smallest scale, ≥ 0.
        turns: (N, 3) vector part of the rotation, whose scalar part is the largest and positive.
    """

    roots: NDArray
    sizes: NDArray
    lengths: NDArray
    thins: NDArray
    turns: NDArray

    def as_spheres(self) -> Columns:
        """Of the same volumes, as nobody knows how they are turned."""
        none = np.zeros_like(self.sizes)
        lengths, thins = np.clip(self.lengths, 0, MAX_EXPONENT), np.clip(self.thins, 0, MAX_EXPONENT)
        return replace(self, sizes=self.sizes - lengths / 6 - thins / 3, lengths=none, thins=none)


def to_columns(gaussians: Gaussians, rows: NDArray) -> Columns:
    """The channels of `rows` (n,) integer of (N,) Gaussians."""
    starts = range(0, len(rows), ROWS)
    names = [column.name for column in fields(Columns)]
    parts = [_part_of(gaussians, rows[start : start + ROWS]) for start in starts]
    return Columns(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _part_of(gaussians: Gaussians, rows: NDArray) -> Columns:
    scales = np.maximum(gaussians.scales[rows].astype(np.float64), LEAST_SCALE)
    axes = np.argsort(-scales, axis=1, kind="stable")
    logs = np.log(np.take_along_axis(scales, axes, axis=1))
    return Columns(
        roots=np.sqrt(gaussians.opacities[rows].astype(np.float64)),
        sizes=(logs[:, 0] + logs[:, 1]) / 2,
        lengths=np.minimum(logs[:, 0] - logs[:, 1], MAX_RATIO),
        thins=np.minimum(logs[:, 1] - logs[:, 2], MAX_RATIO),
        turns=_turns(gaussians.quats[rows], axes),
    )


def _turns(quats: NDArray, axes: NDArray) -> NDArray:
    """Vector parts (N, 3) of the rotations whose first axis is `axes[:, 0]` of the given ones, and so on."""
    length = np.abs(quats).max(axis=1, keepdims=True).astype(np.float64)
    matrices = quats_to_matrices(normalize_quats(quats / length))
    matrices = np.take_along_axis(matrices, axes[:, None, :], axis=2)
    a, b, c = axes.T
    matrices[:, :, 2] *= np.sign((b - a) * (c - a) * (c - b))[:, None]  # an odd order would mirror
    turned = matrices_to_quats(matrices)
    # Scalar parts of the four that look alike are the four components, but for their signs.
    chosen = multiply_quats(turned, _HALF_TURNS[np.abs(turned).argmax(axis=1)])
    return chosen[:, 1:] * np.where(chosen[:, :1] < 0, -1, 1)


def from_columns(columns: Columns, growth: float = 0.0) -> dict[str, NDArray]:
    """Quats (N, 4), scales (N, 3), opacities (N,) float32 of channels with any decoded numbers.

    `growth` is added to logarithms of scales.
    """
    count = len(columns.roots)
    lengths, thins = np.clip(columns.lengths, 0, MAX_EXPONENT), np.clip(columns.thins, 0, MAX_EXPONENT)
    second = columns.sizes - lengths / 2
    scales, quats = np.empty((count, 3), np.float32), np.empty((count, 4), np.float32)
    for axis, logs in enumerate((columns.sizes + lengths / 2, second, second - thins)):
        scales[:, axis] = np.exp(np.clip(logs + growth, -MAX_EXPONENT, MAX_EXPONENT))
    x, y, z = columns.turns.T
    scalar = np.sqrt(np.maximum(1 - (x * x + y * y + z * z), 0))
    length = np.sqrt(scalar * scalar + x * x + y * y + z * z)
    for axis, values in enumerate((scalar, x, y, z)):
        quats[:, axis] = values / length
    opacities = np.square(np.clip(columns.roots, 0, 1)).astype(np.float32)
    return {"quats": quats, "scales": scales, "opacities": opacities}


def companded(sizes: NDArray, middle: float) -> NDArray:
    """Log sizes, float of any shape, such that equal steps look alike: larger Gaussians cover more of a picture.

    Steps are those of the logarithm at `middle`, and up to 8 times finer or coarser.
    """
    x = sizes - middle
    near = 2 * np.exp(np.clip(x, -KNEE, KNEE) / 2)
    return near + np.minimum(x + KNEE, 0) / 8 + np.maximum(x - KNEE, 0) * 8


def expanded(values: NDArray, middle: float) -> NDArray:
    """Inverse of `companded`, of float numbers of any shape; within ±`MAX_EXPONENT`."""
    near = 2 * np.log(np.clip(values, 1 / 4, 16) / 2)
    x = near + np.minimum(values - 1 / 4, 0) * 8 + np.maximum(values - 16, 0) / 8
    return np.clip(x + middle, -MAX_EXPONENT, MAX_EXPONENT)
