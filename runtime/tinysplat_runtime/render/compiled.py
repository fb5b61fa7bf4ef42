"""The whole way from Gaussians to a picture as compiled code, chosen where numba is installed (`tinysplat[fast]`).

The definitions are those of `project.py` and `composite.py`, the pictures the same to 1e-5, in a fraction of the time.
A frame takes two passes, both of them over pieces that threads share: blocks of Gaussians are projected and listed by
the tiles of pixels that they reach; then every tile sorts its own list by depth and blends it. No stage waits for one
thread alone, which a sort of all splats would.

Only the loops in `kernels_project.py` and `kernels_blend.py` need numba; `Renderer` imports this module where it is.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..system.stopwatch import part
from . import kernels_blend, kernels_project
from .kernels_blend import TILE_HEIGHT, TILE_WIDTH
from .kernels_project import BOTTOM, CHUNK, GAMMA, GEOMETRY, LAST, LEFT, LOG_OPACITY, REACH, RECORD, RIGHT, TOP
from .near import Shares
from .prepare import Block, Part, Shelf
from .project import View, footprint_exponent, jacobian_limits, pixels_between, wide_shapes
from .tiles import WIDE_MARGIN

MAX_KEYS = 4_000_000
"""Most (tile, splat) pairs listed at a time, 16 bytes each, unless a single tile has more."""


@dataclass(frozen=True, eq=False)
class _Packed:
    """A block in the order that the loops want.

    Attributes:
        block: the Gaussians without their planes.
        first: row of its first record.
        geometry: (chunks·14·128,) float32, see `kernels_project.project`. Rows that fill the last chunk up have no
            opacity, which keeps them out of every picture.
        sh: (chunks, 3 S·128) float32.
        is_coloured: (chunks,) uint8, which chunks' records hold colours as seen from the renderer's present place.
    """

    block: Block
    first: int
    geometry: NDArray
    sh: NDArray
    is_coloured: NDArray

    @property
    def rows(self) -> slice:
        return slice(self.first, self.first + CHUNK * self.is_coloured.size)


@dataclass(frozen=True, eq=False)
class Visible:
    """What of a block a frame shows: rows of records (m,), their tiles (m, 4), and how many by tile (tiles,)."""

    ids: NDArray
    boxes: NDArray
    counts: NDArray


class Workspace:
    """Scratch arrays of one thread."""

    def __init__(self) -> None:
        self.chunk = np.empty(kernels_project.SCRATCH, np.float32)
        self.state = np.empty(kernels_blend.STATE, np.float32)
        self.near = np.empty((kernels_blend.AHEAD, RECORD), np.float32)
        self.histogram = np.empty(kernels_blend.DIGITS, np.int64)


class Canvas:
    """What every pixel has gathered: (H, W, 3) and (H, W) float32, `depth` (0, 0) where none is asked for."""

    def __init__(self, height: int, width: int, with_depth: bool) -> None:
        self.colour = np.empty((height, width, 3), np.float32)
        self.left = np.empty((height, width), np.float32)
        self.depth = np.empty((height, width) if with_depth else (0, 0), np.float32)

    def colours(self) -> NDArray:
        """(H, W, 3) what the splats add."""
        return self.colour

    def transmittance(self) -> NDArray:
        """(H, W) what the splats let through."""
        return self.left

    def depths(self) -> tuple[NDArray, NDArray]:
        """(H, W) each: Σ w·z, and Σ w."""
        return self.depth, np.float32(1) - self.left


class Rasteriser:
    """Draws the same Gaussians again and again.

    Between frames it keeps the packed Gaussians and all buffers, and the colours for as long as the camera's centre
    stays where it is: turning, zooming and other sizes leave the directions that SH depend on alone.
    """

    def __init__(self, parts: Sequence[Part], places: int, run_jobs: Callable) -> None:
        """Parts are packed when a frame needs them, and kept while there are places; `run_jobs` maps over a list."""
        longest = CHUNK * max(-(-part.size // CHUNK) for part in parts)
        self._shelf = Shelf(lambda number, place: _packed(parts[number].block(), place * longest), places)
        rows = places * longest
        self._records = np.empty((rows, RECORD), np.float32)
        self._ids, self._boxes = np.empty(rows, np.int32), np.empty((rows, 4), np.int16)
        self._place = np.full(3, np.nan)
        self._run = run_jobs
        self._local = threading.local()

    def draw(self, drawn: Sequence[int], view: View, shares: Shares | None, with_depth: bool) -> Canvas:
        """Draw a frame of some parts; without `shares` as they are, by depth."""
        height, width = view.camera.height, view.camera.width
        canvas = Canvas(height, width, with_depth)
        columns, count = -(-width // TILE_WIDTH), -(-width // TILE_WIDTH) * -(-height // TILE_HEIGHT)
        if not np.array_equal(view.offset, self._place):
            self._place = view.offset
            for packed in self._shelf:
                packed.is_coloured[:] = 0
        visible = self._run(lambda packed: self._project(packed, view, shares, columns, count), self._shelf.take(drawn))
        counts = np.stack([np.zeros(count, np.int64), *(shown.counts for shown in visible)])  # (blocks + 1, tiles)
        for first, last in batches(counts.sum(axis=0)):
            has_front = shares is not None and shares.has_front
            self._composite(visible, counts[1:, first:last], (first, last), columns, canvas, has_front)
        return canvas

    def _workspace(self) -> Workspace:
        if not hasattr(self._local, "workspace"):
            self._local.workspace = Workspace()
        return self._local.workspace

    def _project(self, packed: _Packed, view: View, shares: Shares | None, columns: int, count: int) -> Visible:
        """Fill a block's records, and list what of them is visible."""
        records, work = self._records[packed.rows], self._workspace()
        block = packed.block
        whole, front = (0.0, -math.inf) if shares is None else shares.of(block.view, block.is_surface)
        numbers = view_numbers(view, whole)
        with part("projection and colours"):
            is_wide = kernels_project.project(
                packed.geometry, packed.sh, packed.is_coloured, numbers, work.chunk, records
            )
        if is_wide:
            redo_wide(block.fainter(whole), view, records)
        if shares is not None:
            records[:, LAST] = front
        ids, boxes, counts = self._ids[packed.rows], self._boxes[packed.rows], np.zeros(count, np.int64)
        with part("listing what is visible"):
            shown = kernels_blend.list_visible(records, packed.first, columns, ids, boxes, counts)
        return Visible(ids[:shown], boxes[:shown], counts)

    def _composite(
        self,
        visible: list[Visible],
        counts: NDArray,
        tiles: tuple[int, int],
        columns: int,
        canvas: Canvas,
        has_front: bool,
    ) -> None:
        """Blend some tiles; `counts` (blocks, tiles) of their splats."""
        ends = np.cumsum(counts.T).reshape(-1, len(visible))  # a tile's list holds its splats block by block
        bounds = np.append(0, ends[:, -1])
        starts = np.ascontiguousarray((ends - counts.T).T)
        keys, scratch = np.empty((2, bounds[-1]), np.uint64)

        def list_block(block: tuple[Visible, NDArray]) -> None:
            seen, start = block
            kernels_blend.list_by_tile(self._records, seen.ids, seen.boxes, columns, tiles, start, keys)

        def blend(tile: int) -> None:
            work, own = self._workspace(), slice(bounds[tile], bounds[tile + 1])
            row, column = divmod(tiles[0] + tile, columns)
            kernels_blend.composite_tile(
                self._records, keys[own], scratch[own], (row * TILE_HEIGHT, column * TILE_WIDTH),
                (work.state, work.near, work.histogram), (canvas.colour, canvas.left, canvas.depth), has_front,
            )  # fmt: skip

        with part("lists by tile"):
            self._run(list_block, list(zip(visible, starts, strict=True)))
        with part("sort and blend"):
            # the longest first, so that threads end together
            self._run(blend, np.argsort(np.diff(bounds))[::-1].tolist())


def _packed(block: Block, first: int) -> _Packed:
    chunks, functions = -(-block.size // CHUNK), block.sh.shape[0]
    planes = np.zeros((GEOMETRY, chunks * CHUNK), np.float32)
    planes[12] = -np.inf
    planes[:3, : block.size] = block.means
    planes[3:12, : block.size] = block.axes.reshape(9, -1)
    planes[12, : block.size] = block.log_opacities
    if block.own_pixels is not None:
        planes[13, : block.size] = block.own_pixels
    sh = np.zeros((3 * functions, chunks * CHUNK), np.float32)
    sh[:, : block.size] = block.sh.reshape(3 * functions, -1)
    geometry, sh = (_by_chunk(planes, chunks) for planes in (planes, sh))
    return _Packed(block.without_planes(), first, geometry.ravel(), sh, np.zeros(chunks, np.uint8))


def _by_chunk(planes: NDArray, chunks: int) -> NDArray:
    """(planes, chunks·128) to (chunks, planes·128)."""
    by_chunk = np.ascontiguousarray(planes.reshape(len(planes), chunks, CHUNK).swapaxes(0, 1))
    return by_chunk.reshape(chunks, len(planes) * CHUNK)


def view_numbers(view: View, log_share: float = 0.0) -> NDArray:
    """(23,) float64: a view, and the share of opacities that is drawn, as `kernels_project.project` takes them."""
    rest = [view.near_plane, view.camera.width, view.camera.height, view.camera.focal, log_share]
    principal = view.camera.K[:2, 2]
    return np.concatenate([view.offset, principal, *jacobian_limits(view), view.projection.ravel(), rest])


def batches(counts: NDArray) -> Iterator[tuple[int, int]]:
    """Ranges of tiles that have at most `MAX_KEYS` splats together, or a single tile."""
    ends = np.cumsum(counts)
    first = 0
    while first < counts.size:
        before = ends[first - 1] if first else 0
        last = max(int(np.searchsorted(ends, before + MAX_KEYS, side="right")), first + 1)
        yield first, last
        first = last


def redo_wide(block: Block, view: View, records: NDArray) -> None:
    """Do what float32 is too narrow for in float64, by the code of the numpy path."""
    rows = np.flatnonzero(records[: block.size, LAST])
    planes, half, log_opacities = wide_shapes(block, view, rows)
    tau = footprint_exponent(log_opacities)
    shows = np.isfinite(planes).all(axis=0) & (tau >= 0)  # below, edges are NaN, and no number of a tile
    with np.errstate(all="ignore"):
        edges = []
        for centre, extent, size in zip(planes[:2], half, (view.camera.width, view.camera.height), strict=True):
            edges.append(pixels_between(centre - extent * np.sqrt(tau), centre + extent * np.sqrt(tau), size))
            shows &= edges[-1][0] <= edges[-1][1]
        reach = np.sqrt(tau + np.float32(WIDE_MARGIN)) / planes[GAMMA]
        top, bottom = pixels_between(planes[1] - reach, planes[1] + reach, view.camera.height)
    records[rows, : GAMMA + 1], records[rows, LOG_OPACITY] = planes.T, log_opacities
    records[rows, LEFT], records[rows, TOP], records[rows, BOTTOM], records[rows, REACH] = 0, top, bottom, 0
    records[rows, RIGHT] = np.where(shows & (top <= bottom), view.camera.width - 1, -1)
