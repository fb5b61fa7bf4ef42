"""What does not depend on the camera: Gaussians cut into blocks of planar arrays.

Planar means one contiguous row per component, (3, n) instead of (n, 3): numpy's loops then run over n contiguous
floats. A block is sized so that its temporaries stay in a core's L2 cache while it is projected.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..gaussian.footprints import own_pixels
from ..gaussian.gaussians import FIELDS, Gaussians
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
        own_pixels: (n,) float32, how wide a pixel of the photo that each stands for is at its depth: z / f of its own
            view, scene units; 0 where it lies behind that view. None where they are of no known photo.
        view: the view whose surface (layer 0) they are; −1 where they are not one view's, or of another layer.
    """

    first: int
    means: NDArray
    axes: NDArray
    log_opacities: NDArray
    sh: NDArray
    quats: NDArray
    scales: NDArray
    own_pixels: NDArray | None = None
    view: int = -1

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


def prepare(gaussians: Gaussians, *, by_view: bool = False) -> Iterator[Block]:
    """Cut all layers of the Gaussians into blocks, in order; those that can never show are left out.

    Args:
        gaussians: with cameras if `by_view`.
        by_view: cut between views, too, and say of what photo's pixels the Gaussians are.
    """
    first = 0
    for view, rows in _view_rows(gaussians) if by_view else _rows(gaussians.layers):
        shows = rows["opacities"] >= ALPHA_MIN
        if not shows.all():
            rows = {name: array[shows] for name, array in rows.items()}
        if rows["opacities"].size:
            block = _block(first, view, **rows)
            yield block
            first += block.size


def _rows(layers: Iterable[Gaussians]) -> Iterator[tuple[int, dict[str, NDArray]]]:
    """No view, and the arrays of up to `BLOCK_SIZE` Gaussians at a time."""
    for layer in layers:
        count, functions = layer.opacities.size, layer.sh.shape[-2]
        rows = {
            "means": layer.means.reshape(count, 3),
            "quats": layer.quats.reshape(count, 4),
            "scales": layer.scales.reshape(count, 3),
            "opacities": layer.opacities.reshape(count),
            "sh": layer.sh.reshape(count, functions, 3),
        }
        for start in range(0, count, BLOCK_SIZE):
            yield -1, {name: array[start : start + BLOCK_SIZE] for name, array in rows.items()}


def _view_rows(gaussians: Gaussians) -> Iterator[tuple[int, dict[str, NDArray]]]:
    """The view whose surface they are, and the same arrays and `own_pixels`, of one view at a time."""
    for layer in gaussians.layers:
        for view, camera in enumerate(gaussians.cameras):
            of_view = Gaussians.unchecked(**{name: getattr(layer, name)[view] for name in FIELDS})
            for _, rows in _rows([of_view]):
                pixels = own_pixels(rows["means"], gaussians.origin, camera)
                yield view if layer is gaussians else -1, {**rows, "own_pixels": pixels}


def _block(
    first: int,
    view: int,
    *,
    means: NDArray,
    quats: NDArray,
    scales: NDArray,
    opacities: NDArray,
    sh: NDArray,
    own_pixels: NDArray | None = None,
) -> Block:
    return Block(
        first=first,
        means=np.ascontiguousarray(means.T),
        axes=principal_axes(quats, scales),
        log_opacities=np.log(opacities),
        sh=np.ascontiguousarray(np.moveaxis(sh, 0, -1)),
        quats=quats,
        scales=scales,
        own_pixels=own_pixels,
        view=view,
    )
