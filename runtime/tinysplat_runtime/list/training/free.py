"""Gaussians of a list, which may move anywhere: how well they draw a picture, and what would mend it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians
from ...gaussian.quaternions import normalize_quats
from ...render.gradient import Comparer, PhotoError, Target, fill_chunks, logits_of, opacities_of, padded
from ...render.kernels_blend import Extent, Picture, Scratch, composite_tile
from ...render.kernels_gradient import Sought, differentiate_tile
from ...render.kernels_list import Listed, Visible
from ...render.kernels_project import CHUNK, GEOMETRY, MEAN, OPACITY, OWN_PIXEL
from ...render.lists import Chunks, TileLists, view_numbers
from ...render.prepare import BLOCK_SIZE, Block
from ...render.project import View
from ...render.renderer import NEAR_PLANE
from ...scene.cameras import Camera
from . import kernels_free
from .kernels_free import BASE, LOG_SCALE, LOGIT, MOVE, SH_RED, TURN, Moved, values_of

LEAST_SCALE = 1e-4
"""Of a Gaussian's unit: thinner axes begin at this, so that they have logarithms and may grow."""


@dataclass(frozen=True, eq=False)
class RowBlock:
    """Rows that are worked on together.

    Attributes:
        rows: which; whole chunks.
        base, geometry, sh: see `kernels_free.place`.
    """

    rows: slice
    base: NDArray
    geometry: NDArray
    sh: NDArray


class FreeGaussians:
    """Gaussians, their values, and what drawing them as 3DGS defines takes.

    Attributes:
        values: (kinds, rows) float32, see `kernels_free.MOVE`; rows behind `count` fill the last chunk and show
            nowhere.
        count: of Gaussians.
        functions: how many SH functions move, of every Gaussian.
        pieces: what is drawn; SH that do not move are changed there.
    """

    def __init__(self, gaussians: Gaussians, units: NDArray, run_jobs: Callable, functions: int = 1) -> None:
        """Begin.

        Args:
            gaussians: (N,).
            units: (N,) lengths in scene units that their means move in.
            run_jobs: maps a function over a list, on any number of threads.
            functions: SH functions that move: 1, 4 or 9, and no more than there are.
        """
        self.functions = functions
        self.count, self._start, self._units = len(gaussians.opacities), gaussians, units.astype(np.float32)
        rows = padded(self.count)
        self.values = np.zeros((values_of(functions), rows), np.float32)
        self.values[LOGIT], self.values[TURN] = -np.inf, 1
        own = self.values[:, : self.count]
        scales = np.maximum(gaussians.scales, LEAST_SCALE * self._units[:, None])
        own[LOG_SCALE:TURN] = np.log(scales).T
        own[TURN:LOGIT] = normalize_quats(gaussians.quats).T
        own[LOGIT] = logits_of(gaussians.opacities)
        own[SH_RED:] = gaussians.sh[:, :functions].reshape(self.count, -1).T
        chunks, colours = rows // CHUNK, gaussians.sh.reshape(self.count, -1).T
        planes, sh = np.zeros((chunks, BASE, CHUNK), np.float32), np.zeros((chunks, len(colours) * CHUNK), np.float32)
        fill_chunks(planes, np.concatenate([gaussians.means.T, self._units[None]]))
        fill_chunks(sh.reshape(chunks, -1, CHUNK), colours)
        geometry = np.zeros((chunks, GEOMETRY, CHUNK), np.float32)
        parts = [slice(first, first + BLOCK_SIZE // CHUNK) for first in range(0, chunks, BLOCK_SIZE // CHUNK)]
        self.pieces = [
            RowBlock(slice(CHUNK * part.start, min(CHUNK * part.stop, rows)), planes[part], geometry[part], sh[part])
            for part in parts
        ]
        self._comparer, self._run = Comparer(rows, run_jobs), run_jobs
        self.place()

    def place(self) -> None:
        """Bring what is drawn up to date with `values`."""
        self._run(
            lambda piece: kernels_free.place(piece.base, self.values, piece.rows.start, piece.geometry, piece.sh),
            self.pieces,
        )

    @property
    def opacities(self) -> NDArray:
        """(N,) float64."""
        return opacities_of(self.values[LOGIT, : self.count])

    @property
    def _means(self) -> NDArray:
        return self._start.means + self._units[:, None] * self.values[MOVE:LOG_SCALE, : self.count].T.astype(np.float64)

    def gaussians(self) -> Gaussians:
        """As they stand."""
        own = self.values[:, : self.count].astype(np.float64)
        planes = [piece.sh.reshape(len(piece.sh), -1, CHUNK).swapaxes(1, 2) for piece in self.pieces]
        sh = np.concatenate(planes).reshape(-1, *self._start.sh.shape[1:])[: self.count]
        fields: dict[str, Any] = {
            "means": self._means,
            "scales": np.exp(own[LOG_SCALE:TURN]).T,
            "quats": normalize_quats(own[TURN:LOGIT].T),
            "opacities": self.opacities,
            "sh": sh,
        }
        return replace(self._start, **fields)

    def pulled(self, gradient: NDArray) -> tuple[NDArray, NDArray]:
        """(N, 3) float64 means in the world, and (N, 3) a loss's gradient with respect to them, of one with respect to
        `values`.
        """
        slopes = gradient[MOVE:LOG_SCALE, : self.count].T.astype(np.float64)
        return self._start.origin + self._means, slopes / self._units[:, None]

    def kept(self, keep: NDArray) -> FreeGaussians:
        """Those of a mask (N,) bool, as they are now."""
        return FreeGaussians(self.gaussians().taken(keep), self._units[keep], self._run, self.functions)

    def measure(
        self, target: Target, *, gradient: NDArray | None = None, weight: float = 1.0, structure: float = 0.0
    ) -> PhotoError:
        """Draw a picture as 3DGS defines and hold it against a target.

        Args:
            target: what it should be.
            gradient: (kinds, rows) float32 that gradients with respect to `values` are added to, or None.
            weight: what a unit of the loss counts in `gradient`.
            structure: share of 1 − SSIM in the loss, beside |error|.
        """
        view, visible = self._seen(target.camera)
        sought = Sought(target.photo, *map(np.float32, (weight, structure, target.backdrop)))
        add_up = None if gradient is None else partial(self._add_up, visible, view, gradient)
        return self._comparer.compare(visible, view, sought, add_up)

    def draw(self, camera: Camera) -> NDArray:
        """(H, W, 4) float32: a picture before black as 3DGS defines it, and its transmittance."""
        picture = np.empty((camera.height, camera.width, 4), np.float32)
        sides = Picture(picture[..., :3], picture[..., 3], np.empty((0, 0), np.float32))

        def draw(_: int, listed: Listed, extent: Extent, scratch: Scratch, pairs: NDArray) -> None:
            composite_tile(listed, extent, scratch, sides, False)

        view, visible = self._seen(camera)
        self._comparer.walk(visible, view, draw)
        return picture

    def gradient(self, camera: Camera, slopes: NDArray) -> NDArray:
        """(kinds, rows) float32: a loss's gradient with respect to `values`.

        Args:
            camera: as `draw` was given it.
            slopes: (H, W, 4) float32, the loss's gradient with respect to what `draw` returned.
        """

        def walk(_: int, listed: Listed, extent: Extent, scratch: Scratch, pairs: NDArray) -> None:
            differentiate_tile(listed, extent, scratch, slopes, pairs)

        view, visible = self._seen(camera)
        gradient = np.zeros_like(self.values)
        self._comparer.walk(visible, view, walk, partial(self._add_up, visible, view, gradient))
        return gradient

    def _seen(self, camera: Camera) -> tuple[View, list[Visible]]:
        """A camera's view, and what of each piece it shows."""
        view = View.of(camera, self._start.origin, NEAR_PLANE)
        return view, self._run(lambda piece: self._project(piece, view), self.pieces)

    def _project(self, piece: RowBlock, view: View) -> Visible:
        chunks = Chunks(piece.rows.start, piece.geometry.ravel(), piece.sh, lambda: self._block(piece))
        return self._comparer.buffers.project(chunks, view)

    def _block(self, piece: RowBlock) -> Block:
        """A piece as it stands, for the code that works in float64."""
        rows = slice(piece.rows.start, min(piece.rows.stop, self.count))
        planes = piece.geometry.swapaxes(0, 1).reshape(GEOMETRY, -1)[:, : rows.stop - rows.start]
        nothing = np.zeros((0, 3, 0), np.float32)
        scales, quats = np.exp(self.values[LOG_SCALE:TURN, rows]).T, normalize_quats(self.values[TURN:LOGIT, rows].T)
        means, opacities = planes[MEAN : MEAN + 3], planes[OPACITY]
        return Block(means, nothing, opacities, nothing, quats, scales, planes[OWN_PIXEL])

    def _add_up(
        self, visible: Sequence[Visible], view: View, gradient: NDArray, lists: TileLists, pairs: NDArray
    ) -> None:
        numbers = view_numbers(view)

        def add(number: int) -> None:
            piece = self.pieces[number]
            moved = Moved(piece.rows.start, piece.geometry, piece.base[:, 3], self.values, gradient)
            records, seen, ends = self._comparer.buffers.records, visible[number], lists.starts[number]
            kernels_free.add_up(records, seen, lists.tiles, ends, pairs, moved, numbers)

        self._run(add, range(len(self.pieces)))
