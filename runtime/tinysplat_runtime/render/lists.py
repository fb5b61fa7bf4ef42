"""Which splats reach which tile, for loops that are compiled: what drawing and gradients share.

Blocks of Gaussians are projected and listed by the tiles of pixels that they reach, each for itself; then tiles are
worked on, each for itself. Threads share both.
"""

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import kernels_blend, kernels_list, kernels_project
from .kernels_blend import Extent, Scratch
from .kernels_list import TILE_HEIGHT, TILE_WIDTH, Listed, Tiles, Visible
from .kernels_project import BOTTOM, GAMMA, LAST, LEFT, LOG_OPACITY, REACH, RECORD, RIGHT, TOP, ViewNumbers
from .prepare import Block
from .project import View, footprint_exponent, jacobian_limits, pixels_between, wide_shapes
from .tiles import WIDE_MARGIN

MAX_KEYS = 1_000_000
"""Most (tile, splat) pairs listed at a time, 20 bytes each, unless a single tile has more."""


@dataclass(frozen=True, eq=False)
class Chunks:
    """A block as `kernels_project.project` takes it.

    Attributes:
        first: row of its first record.
        geometry: (chunks·14·128,) float32. Rows that fill the last chunk up have no opacity, which keeps them out of
            every picture.
        sh: (chunks, 3 S·128) float32.
        block: makes the Gaussians, without `axes` and `sh`.
    """

    first: int
    geometry: NDArray
    sh: NDArray
    block: Callable[[], Block]


@dataclass(frozen=True, eq=False)
class TileLists:
    """The lists of some tiles.

    Attributes:
        tiles: which.
        bounds: (tiles + 1,) int64 where each list begins.
        starts: (blocks, tiles) int64 where each block's part of it begins.
        keys, rows: as `kernels_list.list_by_tile` writes them.
    """

    tiles: Tiles
    bounds: NDArray
    starts: NDArray
    keys: NDArray
    rows: NDArray


class SplatBuffers:
    """Records of splats, and what threads need in order to work on them.

    Attributes:
        records: (rows, 16) float32, every Gaussian's in its place, or of those alone that may show, block by block.
    """

    def __init__(self, rows: int, run_jobs: Callable, only_shown: bool = False) -> None:
        """`run_jobs` maps a function over a list, on any number of threads; `only_shown` leaves out records, and with
        them memory, of what does not show.
        """
        self.records = np.empty((rows, RECORD), np.float32)
        self._found = None if only_shown else (np.empty(rows, np.int32), np.empty((rows, 4), np.int16))
        self._run, self._work, self._lock, self._used = run_jobs, _Workspace(), threading.Lock(), 0

    def clear(self) -> None:
        """Make place for another frame's records where there are only those that may show."""
        self._used = 0

    def project(self, chunks: Chunks, view: View, front: float = 0.0, opaque: float = 1.0) -> Visible:
        """Fill a block's records, and list what of them is visible.

        Args:
            chunks: the block.
            view: the camera.
            front: share of its Gaussians' alphas that is drawn before everything else.
            opaque: share of their opacities that they have.
        """
        rows = kernels_project.CHUNK * len(chunks.sh)
        if self._found is None:
            first, (records, ids, boxes) = 0, self._work.block(rows)
            gaussians = ids
        else:
            first, gaussians = chunks.first, np.zeros(0, np.int32)
            records, ids, boxes = (array[first : first + rows] for array in (self.records, *self._found))
        numbers, scratch = view_numbers(view), self._work.chunk
        count, wide = kernels_project.project(chunks.geometry, chunks.sh, numbers, scratch, records, gaussians)
        records = records[:count]
        if wide:
            _redo_wide(chunks.block(), view, records, gaussians)
        records[:, LAST] = front
        if opaque < 1:
            records[:, LOG_OPACITY] += np.float32(math.log(opaque))
        visible = _visible(records, first, ids, boxes, view)
        if self._found is None:
            place = self._put(records)
            return Visible(visible.ids + np.int32(place), visible.boxes.copy(), visible.counts)
        return visible

    def _put(self, records: NDArray) -> int:
        """Take in a block's records; their first row."""
        with self._lock:
            first, self._used = self._used, self._used + len(records)
        self.records[first : first + len(records)] = records
        return first

    def lists(self, visible: Sequence[Visible], view: View) -> Iterator[TileLists]:
        """Lists of a few tiles after the other; a tile's list holds its splats block by block."""
        grid = _grid(view)
        counts = np.stack([seen.counts for seen in visible])  # (blocks, tiles)
        for first, stop in _batches(counts.sum(axis=0)):
            here, tiles = counts[:, first:stop], Tiles(first, stop, grid.columns)
            ends = np.cumsum(here.T).reshape(-1, len(visible))
            bounds, starts = np.append(0, ends[:, -1]), np.ascontiguousarray((ends - here.T).T)
            found = TileLists(tiles, bounds, starts, np.empty(bounds[-1], np.uint64), np.empty(bounds[-1], np.int32))

            def list_block(block: tuple[Visible, NDArray], found: TileLists = found) -> None:
                kernels_list.list_by_tile(self.records, block[0], found.tiles, block[1], found.keys, found.rows)

            self._run(list_block, list(zip(visible, starts.copy(), strict=True)))
            yield found

    def work_on(self, lists: TileLists, view: View, work: Callable[[int, Listed, Extent, Scratch], None]) -> None:
        """Call `work` with every tile's number, list, place and the thread's scratch."""
        scratch = np.empty_like(lists.keys)
        height, width = view.camera.height, view.camera.width

        def one(number: int) -> None:
            own = slice(lists.bounds[number], lists.bounds[number + 1])
            tile_row, tile_column = divmod(lists.tiles.first + number, lists.tiles.columns)
            row, column = tile_row * TILE_HEIGHT, tile_column * TILE_WIDTH
            extent = Extent(row, column, min(TILE_HEIGHT, height - row), min(TILE_WIDTH, width - column))
            listed = Listed(self.records, lists.rows, lists.keys[own], scratch[own])
            work(lists.tiles.first + number, listed, extent, self._work.tile)

        # the longest first, so that threads end together
        self._run(one, np.argsort(np.diff(lists.bounds))[::-1].tolist())


class _Workspace(threading.local):
    """Every thread's own scratch arrays."""

    def __init__(self) -> None:
        self.chunk = np.empty(kernels_project.SCRATCH, np.float32)
        self._block = self._block_of(0)
        self.tile = Scratch(
            np.empty(kernels_blend.STATE, np.float32),
            np.empty((kernels_blend.AHEAD, RECORD), np.float32),
            np.empty(kernels_list.DIGITS, np.int64),
        )

    def block(self, rows: int) -> list[NDArray]:
        """Place for a block's (rows, 16) float32 records, (rows,) int32 numbers and (rows, 4) int16 boxes."""
        if len(self._block[0]) < rows:
            self._block = self._block_of(rows)
        return [array[:rows] for array in self._block]

    @staticmethod
    def _block_of(rows: int) -> tuple[NDArray, NDArray, NDArray]:
        return np.empty((rows, RECORD), np.float32), np.empty(rows, np.int32), np.empty((rows, 4), np.int16)


def view_numbers(view: View) -> ViewNumbers:
    """A view as `kernels_project.project` takes it."""
    camera, limits = view.camera, jacobian_limits(view)
    vectors = [view.offset, camera.K[:2, 2], *limits, *view.projection]
    numbers: list[Any] = [tuple(map(float, vector)) for vector in vectors]
    numbers += map(float, (view.near_plane, camera.width, camera.height, camera.focal))
    return ViewNumbers(*numbers)


def _visible(records: NDArray, first: int, ids: NDArray, boxes: NDArray, view: View) -> Visible:
    """What a view shows of records of which `first` is the first one's row; `ids` and `boxes` are written."""
    grid = _grid(view)
    found = Visible(ids, boxes, np.zeros(grid.stop, np.int64))
    shown = kernels_list.list_visible(records, first, grid.columns, found)
    return Visible(ids[:shown], boxes[:shown], found.counts)


def _grid(view: View) -> Tiles:
    """All tiles of a picture."""
    columns = -(-view.camera.width // TILE_WIDTH)
    return Tiles(0, columns * -(-view.camera.height // TILE_HEIGHT), columns)


def _batches(counts: NDArray) -> Iterator[tuple[int, int]]:
    """Ranges of tiles that have at most `MAX_KEYS` splats together, or a single tile."""
    ends = np.cumsum(counts)
    first = 0
    while first < counts.size:
        before = ends[first - 1] if first else 0
        last = max(int(np.searchsorted(ends, before + MAX_KEYS, side="right")), first + 1)
        yield first, last
        first = last


def _redo_wide(block: Block, view: View, records: NDArray, gaussians: NDArray) -> None:
    """Do what float32 is too narrow for in float64, by the code of the numpy path; `gaussians` are those of the records
    if they are not all, one after the other."""
    rows = np.flatnonzero(records[: block.size, LAST])
    planes, half, log_opacities = wide_shapes(block, view, gaussians[rows] if gaussians.size else rows)
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
