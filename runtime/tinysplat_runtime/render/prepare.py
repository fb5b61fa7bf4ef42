"""What does not depend on the camera: Gaussians cut into blocks of planar arrays.

Planar means one contiguous row per component, (3, n) instead of (n, 3): numpy's loops then run over n contiguous
floats. A block is sized so that its temporaries stay in a core's L2 cache while it is projected.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..gaussian.footprints import nearest_pixels, own_pixels
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
        means: (3, n) float32, relative to the Gaussians' origin.
        axes: (3, 3, n) float32, R(q)·diag(s): axes[:, k] is the k-th principal axis, one standard deviation long.
        log_opacities: (n,) float32.
        sh: (S, 3, n) float32.
        quats: (n, 4) float32 and
        scales: (n, 3) float32 as given, for the few rows that need `axes` in float64.
        own_pixels: (n,) float32, how wide a pixel of the photo that each stands for is at its depth: z / f of its own
            view, scene units; 0 where it lies behind that view. Of a list, of the photo that shows each largest, and
            negative. None where they are of no known photo.
    """

    means: NDArray
    axes: NDArray
    log_opacities: NDArray
    sh: NDArray
    quats: NDArray
    scales: NDArray
    own_pixels: NDArray | None = None

    @property
    def size(self) -> int:
        """Number of Gaussians n."""
        return self.log_opacities.size

    def compress(self, keep: NDArray) -> Block:
        """The rows where `keep` (n,) bool is true."""
        planes = ("means", "axes", "log_opacities", "sh")
        own = None if self.own_pixels is None else self.own_pixels[keep]
        return replace(
            self,
            **{name: getattr(self, name).compress(keep, axis=-1) for name in planes},
            quats=self.quats[keep],
            scales=self.scales[keep],
            own_pixels=own,
        )


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
        view: the view that they are of; −1 where they are of none, or of several.
        is_surface: whether they are of layer 0.
        rows: their arrays by name, (n, …).
        origin: (3,) float64, of the Gaussians.
        photos: the view whose pixels they stand for, or those that a list was made of; empty where none is known.
    """

    view: int
    is_surface: bool
    rows: Mapping[str, NDArray]
    origin: NDArray
    photos: Sequence[Camera]

    @property
    def size(self) -> int:
        """Number of Gaussians n."""
        return self.rows["opacities"].size

    @cached_property
    def bounds(self) -> NDArray:
        """(8,) float64: least x, y, z of the means, relative to the origin, and greatest; the largest scale; the widest
        own pixel, 0 for none.
        """
        means, own = np.ascontiguousarray(self.rows["means"].T), 0.0  # numpy is slow along a short axis
        low, high = means.min(axis=1), means.max(axis=1)
        if self.photos:  # which grows along one direction, so that it is widest in a corner
            corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
            own = max(float(own_pixels(corners, self.origin, photo).max()) for photo in self.photos)
        return np.array([*low, *high, self.rows["scales"].max(), own])

    @cached_property
    def own_pixels(self) -> NDArray | None:
        """As `Block.own_pixels`; kept, as of a list it takes a look at every photo."""
        if self.view >= 0 and self.photos:
            return own_pixels(self.rows["means"], self.origin, self.photos[0])
        return -nearest_pixels(self.rows["means"], self.origin, self.photos) if self.photos else None

    def block(self, keep: NDArray | None = None) -> Block:
        """The Gaussians, or of them those where `keep` (n,) bool is true, without those that can never show."""
        rows, own = self._shown(keep)
        sh = np.ascontiguousarray(np.moveaxis(rows["sh"], 0, -1))
        return replace(_outline(rows, own), axes=principal_axes(rows["quats"], rows["scales"]), sh=sh)

    def outline(self, keep: NDArray | None = None) -> Block:
        """As `block` without `axes` and `sh`, which take most of the work and of the memory."""
        return _outline(*self._shown(keep))

    def _shown(self, keep: NDArray | None) -> tuple[Mapping[str, NDArray], NDArray | None]:
        """Arrays, and own pixels, of those that can show."""
        shows, own = self.rows["opacities"] >= ALPHA_MIN, self.own_pixels
        keep = shows if keep is None else keep & shows
        if keep.all():
            return self.rows, own
        rows = {name: array.compress(keep, axis=0) for name, array in self.rows.items()}
        return rows, None if own is None else own[keep]


def _outline(rows: Mapping[str, NDArray], own_pixels: NDArray | None) -> Block:
    nothing = np.zeros((0, 3, 0), np.float32)
    means, log_opacities = np.ascontiguousarray(rows["means"].T), np.log(rows["opacities"])
    return Block(means, nothing, log_opacities, nothing, rows["quats"], rows["scales"], own_pixels)


def parts(gaussians: Gaussians, *, by_view: bool = False, own_pixels: bool = True) -> Iterator[Part]:
    """Cut all layers of the Gaussians into parts, in order.

    Args:
        gaussians: with cameras if `by_view`.
        by_view: cut between views, too, and say what view they are of.
        own_pixels: say, too, of what photos' pixels they are.
    """
    for layer in gaussians.layers:
        grids = enumerate(gaussians.cameras) if by_view else [(-1, None)]
        for view, photo in grids:
            arrays = {name: getattr(layer, name) if photo is None else getattr(layer, name)[view] for name in FIELDS}
            photos = (gaussians.viewpoints if photo is None else (photo,)) if own_pixels else ()
            yield from _cut(view, layer is gaussians, arrays, gaussians.origin, photos)


def _cut(
    view: int, is_surface: bool, arrays: Mapping[str, NDArray], origin: NDArray, photos: Sequence[Camera]
) -> Iterator[Part]:
    """Cut a view of a layer, or all of them; arrays by name, with any shape before what a Gaussian has of each."""
    count = arrays["opacities"].size
    own = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "sh": arrays["sh"].shape[-2:]}
    flat = {name: arrays[name].reshape(count, *shape) for name, shape in own.items()}
    for start in range(0, count, BLOCK_SIZE):
        rows = {name: array[start : start + BLOCK_SIZE] for name, array in flat.items()}
        yield Part(view, is_surface, rows, origin, photos)
