"""What does not depend on the camera: Gaussians cut into blocks of planar arrays.

Planar means one contiguous row per component, (3, n) instead of (n, 3): numpy's loops then run over n contiguous
floats. A block is sized so that its temporaries stay in a core's L2 cache while it is projected.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..gaussian.footprints import own_pixels
from ..gaussian.gaussians import FIELDS, Gaussians
from ..gaussian.quaternions import normalize_quats, rotation_entries
from ..scene.cameras import Camera

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

    def compress(self, keep: NDArray) -> Block:
        """The rows where `keep` (n,) bool is true."""
        planes = ("means", "axes", "log_opacities", "sh")
        own = None if self.own_pixels is None else self.own_pixels[keep]
        return replace(
            self, **{name: getattr(self, name).compress(keep, axis=-1) for name in planes}, quats=self.quats[keep],
            scales=self.scales[keep], own_pixels=own,
        )  # fmt: skip

    def without_planes(self) -> Block:
        """The same without `axes` and `sh`, which most of its memory goes to."""
        nothing = np.zeros((0, 3, 0), np.float32)
        return replace(self, axes=nothing, sh=nothing)


def principal_axes(quats: NDArray, scales: NDArray) -> NDArray:
    """R(q)·diag(s) as (3, 3, n) planes of the inputs' dtype; Σ = axes·axesᵀ (Kerbl et al. 2023, eq. 6)."""
    rows = rotation_entries(*normalize_quats(np.ascontiguousarray(quats.T), axis=0))
    lengths = np.ascontiguousarray(scales.T)
    axes = np.empty((3, *lengths.shape), lengths.dtype)
    for row, entries in zip(axes, rows, strict=True):
        for out, entry, length in zip(row, entries, lengths, strict=True):
            np.multiply(entry, length, out=out)
    return axes


@dataclass(frozen=True, eq=False)
class Part:
    """Up to `BLOCK_SIZE` Gaussians as they were given, of which a block can be made when it is wanted.

    Attributes:
        first: as `Block.first`, counted over all Gaussians.
        view: as `Block.view`.
        rows: their arrays by name, (n, …).
        origin: (3,) float64, of the Gaussians.
        photo: the view whose pixels they stand for; None where they are of no known photo.
    """

    first: int
    view: int
    rows: Mapping[str, NDArray]
    origin: NDArray
    photo: Camera | None

    @property
    def size(self) -> int:
        """Number of Gaussians n."""
        return self.rows["opacities"].size

    def own_pixels(self) -> NDArray | None:
        """As `Block.own_pixels`."""
        return None if self.photo is None else own_pixels(self.rows["means"], self.origin, self.photo)

    def block(self, keep: NDArray | None = None) -> Block:
        """The Gaussians, or of them those where `keep` (n,) bool is true, without those that can never show."""
        shows = self.rows["opacities"] >= ALPHA_MIN
        keep = shows if keep is None else keep & shows
        rows = self.rows if keep.all() else {name: array[keep] for name, array in self.rows.items()}
        return Block(
            first=self.first,
            means=np.ascontiguousarray(rows["means"].T),
            axes=principal_axes(rows["quats"], rows["scales"]),
            log_opacities=np.log(rows["opacities"]),
            sh=np.ascontiguousarray(np.moveaxis(rows["sh"], 0, -1)),
            quats=rows["quats"],
            scales=rows["scales"],
            own_pixels=replace(self, rows=rows).own_pixels(),
            view=self.view,
        )


def parts(gaussians: Gaussians, *, by_view: bool = False, own_pixels: bool = True) -> Iterator[Part]:
    """Cut all layers of the Gaussians into parts, in order.

    Args:
        gaussians: with cameras if `by_view`.
        by_view: cut between views, too, and say what view's surface they are.
        own_pixels: then say, too, of what photo's pixels they are.
    """
    first = 0
    for layer in gaussians.layers:
        grids = enumerate(gaussians.cameras) if by_view else [(-1, None)]
        for view, photo in grids:
            arrays = {name: getattr(layer, name) if photo is None else getattr(layer, name)[view] for name in FIELDS}
            count = arrays["opacities"].size
            shapes = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "sh": (layer.sh.shape[-2], 3)}
            flat = {name: arrays[name].reshape(count, *shape) for name, shape in shapes.items()}
            for start in range(0, count, BLOCK_SIZE):
                rows = {name: array[start : start + BLOCK_SIZE] for name, array in flat.items()}
                surface = view if layer is gaussians else -1
                yield Part(first, surface, rows, gaussians.origin, photo if own_pixels else None)
                first += rows["opacities"].size


def prepare(gaussians: Gaussians, *, by_view: bool = False) -> Iterator[Block]:
    """Blocks of all Gaussians but those that can never show; arguments as `parts` has them."""
    first = 0
    for part in parts(gaussians, by_view=by_view):
        block = replace(part.block(), first=first)
        if block.size:
            yield block
            first += block.size
