"""Which splats reach which tile, in depth order.

A tile is 4×4 pixels: small enough that a good part of its pixels lies inside the footprints listed for it. Splats are
put in depth order, each is expanded to the tiles that it reaches, and a stable sort by tile leaves every tile's list
in depth order. Both sorts are radix sorts, which in numpy are the stable sorts of 16-bit integers: ten times faster
than comparisons on any processor, and without a case where they are not.

Splats go through in runs of falling nearness, each of at most `MAX_PAIRS` pairs, which bounds memory whatever the
size and number of splats. Tiles whose pixels have all stopped take no further pairs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .prepare import ALPHA_MIN, BLOCK_SIZE
from .project import GAMMA, LOG_OPACITY, REACH, SLOPE, SPAN_MARGIN_PX, Y_RIGHTMOST, Splats, X, Y

TILE = 4
"""Side of a tile in pixels."""

MAX_PAIRS = 2_000_000
"""Most (tile, splat) pairs listed at a time; while they are sorted, a pair takes about 40 bytes."""


@dataclass(frozen=True)
class Grid:
    """The tiles of an image of `width` × `height` pixels, numbered row by row; the last ones may overhang."""

    width: int
    height: int

    @property
    def columns(self) -> int:
        """Tiles in a row."""
        return -(-self.width // TILE)

    @property
    def rows(self) -> int:
        """Rows of tiles."""
        return -(-self.height // TILE)

    @property
    def count(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows


@dataclass(frozen=True, eq=False)
class Pairs:
    """The splats of every tile, nearest first.

    Attributes:
        splats: (M,) int32, columns in `Splats`, tile after tile.
        bounds: (tiles + 1,) int64, where each tile's list starts in `splats`.
    """

    splats: NDArray
    bounds: NDArray


def stable_argsort(keys: NDArray) -> NDArray:
    """(M,) int64 that sorts uint16 or uint32 keys, ties in their order: a radix sort by digits of 16 bits."""
    if keys.dtype == np.uint16:
        return np.argsort(keys, kind="stable")
    by_low = np.argsort(keys.astype(np.uint16), kind="stable")
    high = (keys >> np.uint32(16)).astype(np.uint16)
    return by_low.take(np.argsort(high.take(by_low), kind="stable"))


def depth_order(depths: NDArray, columns: NDArray) -> NDArray:
    """`columns` by depth, ties in their order. Positive floats sort like their bits."""
    return columns.take(stable_argsort(depths.take(columns).view(np.uint32)))


def runs(bounds: NDArray, order: NDArray, limit: int = MAX_PAIRS) -> Iterator[NDArray]:
    """Cut `order` into runs whose bounding boxes hold at most `limit` tiles, or of a single splat.

    Args:
        bounds: (4, N) pixel bounds, see `Splats`.
        order: (R,) columns.
        limit: tiles in a run.
    """
    left, right, top, bottom = bounds // TILE
    areas = (right - left + 1).astype(np.int64) * (bottom - top + 1)
    ends = np.cumsum(areas.take(order))
    start, done = 0, 0
    while start < order.size:
        stop = max(int(np.searchsorted(ends, done + limit, side="right")), start + 1)
        yield order[start:stop]
        start, done = stop, int(ends[stop - 1])


def find_pairs(splats: Splats, order: NDArray, grid: Grid, open_tiles: NDArray | None, run_jobs: Callable) -> Pairs:
    """List the tiles that a run of splats reaches.

    Args:
        splats: the frame's splats.
        order: (R,) columns of the run, nearest first.
        grid: the tiles.
        open_tiles: (tiles,) bool, which tiles still take splats; None for all.
        run_jobs: maps a function over a list, perhaps on several threads, and returns the results in order.
    """

    def block_pairs(start: int) -> tuple[NDArray, NDArray]:
        tiles, columns = _pairs(splats, order[start : start + BLOCK_SIZE], grid)
        if open_tiles is not None:
            takes = open_tiles.take(tiles)
            tiles, columns = tiles.compress(takes), columns.compress(takes)
        return tiles.astype(np.uint16 if grid.count <= 1 << 16 else np.uint32), columns.astype(np.int32)

    blocks = run_jobs(block_pairs, range(0, order.size, BLOCK_SIZE))
    tiles, columns = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    bounds = np.append(0, np.cumsum(np.bincount(tiles, minlength=grid.count)))
    return Pairs(columns.take(stable_argsort(tiles)), bounds)


def _pairs(splats: Splats, columns: NDArray, grid: Grid) -> tuple[NDArray, NDArray]:
    """(tile, splat) for every tile in which the footprint of a splat may cover a pixel, in the order of `columns`."""
    top, bottom = splats.bounds[2:].take(columns, axis=-1) // TILE
    owner, row = _expand(top, bottom - top + 1)
    columns = columns.take(owner)
    left, right = _row_extent(splats, columns, row)
    low = np.ceil(np.clip(left - np.float32(0.5), 0, grid.width)).astype(np.int32)
    high = np.floor(np.clip(right - np.float32(0.5), -1, grid.width - 1)).astype(np.int32)
    counts = high // TILE - low // TILE + 1
    counts[low > high] = 0
    owner, tile = _expand(row * grid.columns + low // TILE, counts)
    return tile, columns.take(owner)


def _expand(starts: NDArray, counts: NDArray) -> tuple[NDArray, NDArray]:
    """Ranges start … start + count − 1, one after the other: (index of the range, number) for every element."""
    owner = np.repeat(np.arange(counts.size), counts)
    before = np.cumsum(counts) - counts
    return owner, np.arange(owner.size) + (starts - before).take(owner)


def _row_extent(splats: Splats, columns: NDArray, row: NDArray) -> tuple[NDArray, NDArray]:
    """Leftmost and rightmost x of footprints within the pixel centres of a row of tiles.

    The chord of the ellipse at dy is slope·dy ± reach·√(τ − (γ·dy)²). Its right end is concave in dy, so within a
    band of dy it is largest at the rightmost point of the whole ellipse, moved into the band; the left end mirrors.
    """
    x, y, gamma, log_opacity = (splats.planes[i].take(columns) for i in (X, Y, GAMMA, LOG_OPACITY))
    y_rightmost, slope, reach = (splats.spans[i].take(columns) for i in (Y_RIGHTMOST, SLOPE, REACH))
    tau = log_opacity - np.float32(math.log(ALPHA_MIN))
    y_rightmost *= np.sqrt(tau)
    low = (row * TILE).astype(np.float32) + np.float32(0.5) - y
    high = low + np.float32(TILE - 1)
    ends = []
    with np.errstate(over="ignore", invalid="ignore"):
        for sign in (-1, 1):
            dy = np.clip(sign * y_rightmost, low, high)
            half = np.sqrt(np.maximum(tau - np.square(gamma * dy), 0))
            ends.append(x + slope * dy + sign * (reach * half + np.float32(SPAN_MARGIN_PX)))
    return ends[0], ends[1]
