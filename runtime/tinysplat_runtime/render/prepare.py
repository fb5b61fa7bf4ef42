"""What does not depend on the camera: Gaussians cut into blocks of planar arrays.

Planar means one contiguous row per component, (3, n) instead of (n, 3): numpy's loops then run over n contiguous
floats. A block is sized so that its temporaries stay in a core's L2 cache while it is projected.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats, quats_to_matrices

BLOCK_SIZE = 16_384

ALPHA_MIN = 1 / 255
"""One 8-bit step: a Gaussian adds nothing to a pixel where its alpha is smaller, so its footprint ends there."""


@dataclass(frozen=True, eq=False)
class Block:
    """Up to `BLOCK_SIZE` Gaussians, planar.

    Attributes:
        first: index of the first row in the renderer's buffers.
        means: (3, n) float32, relative to the Gaussians' origin.
        axes: (3, 3, n) float32, R(q)·diag(s): axes[:, k] is the k-th principal axis, one standard deviation long.
        log_opacities: (n,) float32.
        sh: (S, 3, n) float32.
        quats: (n, 4) float32 and
        scales: (n, 3) float32 as given, for the few rows that need `axes` in float64.
    """

    first: int
    means: NDArray
    axes: NDArray
    log_opacities: NDArray
    sh: NDArray
    quats: NDArray
    scales: NDArray

    @property
    def size(self) -> int:
        """Number of Gaussians n."""
        return self.log_opacities.size

    def without_planes(self) -> Block:
        """The same without `axes` and `sh`, which most of its memory goes to."""
        nothing = np.zeros((0, 3, 0), np.float32)
        return replace(self, axes=nothing, sh=nothing)


def principal_axes(quats: NDArray, scales: NDArray) -> NDArray:
    """R(q)·diag(s) as (3, 3, n) planes of the inputs' dtype; Σ = axes·axesᵀ (Kerbl et al. 2023, eq. 6)."""
    axes = quats_to_matrices(normalize_quats(quats)) * scales[:, None, :]
    return np.ascontiguousarray(np.moveaxis(axes, 0, -1))


def prepare(gaussians: Gaussians) -> Iterator[Block]:
    """Cut all layers of the Gaussians into blocks, in order; those that can never show are left out."""
    first = 0
    for fields in _slices(gaussians):
        shows = fields["opacities"] >= ALPHA_MIN
        if not shows.all():
            fields = {name: array[shows] for name, array in fields.items()}
        if fields["opacities"].size:
            block = _block(first, **fields)
            yield block
            first += block.size


def _slices(gaussians: Gaussians) -> Iterator[dict[str, NDArray]]:
    for layer in gaussians.layers:
        count, functions = layer.opacities.size, layer.sh.shape[-2]
        rows = {
            "means": layer.means.reshape(count, 3),
            "quats": layer.quats.reshape(count, 4),
            "scales": layer.scales.reshape(count, 3),
            "opacities": layer.opacities.reshape(count),
            "sh": layer.sh.reshape(count, functions, 3),
        }
        for start in range(0, count, BLOCK_SIZE):
            yield {name: array[start : start + BLOCK_SIZE] for name, array in rows.items()}


def _block(first: int, *, means: NDArray, quats: NDArray, scales: NDArray, opacities: NDArray, sh: NDArray) -> Block:
    return Block(
        first=first,
        means=np.ascontiguousarray(means.T),
        axes=principal_axes(quats, scales),
        log_opacities=np.log(opacities),
        sh=np.ascontiguousarray(np.moveaxis(sh, 0, -1)),
        quats=quats,
        scales=scales,
    )
