"""Which splats reach which tile, in depth order.

A tile is 4×4 pixels: small enough that a good part of its pixels lies inside the footprints listed for it. Splats are
put in depth order, each is expanded to the tiles that it reaches, and a stable sort by tile leaves every tile's list
in depth order. Both sorts are radix sorts, which in numpy are the stable sorts of 16-bit integers: several times as
fast as its sorts by comparison, with and without AVX-512.

Splats go through in runs of falling nearness, each of at most `MAX_PAIRS` pairs, which bounds memory whatever the
size and number of splats. Tiles whose pixels have all stopped take no further pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..system.stopwatch import part
from .prepare import BLOCK_SIZE
from .project import GAMMA, LIMIT, Splats, X, Y, footprint_exponent, is_wide, pixels_between

TILE_WIDTH, TILE_HEIGHT = 4, 4
"""Pixels."""

BATCH = 8
"""Splats of a tile that are composited at a time."""

MAX_PAIRS = 2_000_000
"""Most (tile, splat) pairs listed at a time; while they are sorted, a pair takes about 40 bytes."""

PAIRS_PER_TILE = 8
"""Or, in large images, this many for every tile, since each run passes over all tiles."""


WIDE_MARGIN = 0.05
"""Exponent by which the footprints of wide splats are enlarged for the search for their tiles."""

# Planes of `_spans`; the first, second and fifth are those of `Splats.records`
SLOPE, REACH, TAU, Y_RIGHTMOST, HALF_HEIGHT = 2, 3, 5, 6, 7


@dataclass(frozen=True)
class Grid:
    """The tiles of an image of `width` × `height` pixels, numbered row by row; the last ones may overhang."""

    width: int
    height: int

    @property
    def columns(self) -> int:
        """Tiles in a row."""
        return -(-self.width // TILE_WIDTH)

    @property
    def rows(self) -> int:
        """Rows of tiles."""
        return -(-self.height // TILE_HEIGHT)

    @property
    def count(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows


@dataclass(frozen=True, eq=False)
class Pairs:
    """The splats of every tile, nearest first.

    Attributes:
        batches: (M, 8) int32, rows of `Splats`, one tile after the other. A tile's last batch is filled up with the row
            that has no opacity.
        bounds: (tiles + 1,) int64, where each tile's list starts in `batches`.
    """

    batches: NDArray
    bounds: NDArray


def stable_argsort(keys: NDArray) -> NDArray:
    """(M,) int64 that sorts uint16 or uint32 keys, ties in their order: a radix sort by digits of 16 bits."""
    if keys.dtype == np.uint16:
        return np.argsort(keys, kind="stable")
    by_low = np.argsort(keys.astype(np.uint16), kind="stable")
    high = (keys >> np.uint32(16)).astype(np.uint16)
    return by_low.take(np.argsort(high.take(by_low), kind="stable"))


def depth_order(depths: NDArray, ids: NDArray) -> NDArray:
    """`ids` by depth, ties in their order. Positive floats sort like their bits."""
    return ids.take(stable_argsort(depths.take(ids).view(np.uint32)))


def runs(areas: NDArray, order: NDArray, limit: int) -> Iterator[NDArray]:
    """Cut `order` (R,) into runs whose `areas` (N,) sum to at most `limit`, or of a single splat."""
    ends = np.cumsum(areas.take(order), dtype=np.int64)
    start, done = 0, 0
    while start < order.size:
        stop = max(int(np.searchsorted(ends, done + limit, side="right")), start + 1)
        yield order[start:stop]
        start, done = stop, int(ends[stop - 1])


def find_pairs(splats: Splats, order: NDArray, grid: Grid, open_tiles: NDArray | None, run_jobs: Callable) -> Pairs:
    """List the tiles that a run of splats reaches.

    Args:
        splats: the frame's splats.
        order: (R,) rows of the run's splats, nearest first.
        grid: the tiles.
        open_tiles: (tiles,) bool, which tiles still take splats; None for all.
        run_jobs: maps a function over a list, perhaps on several threads, and returns the results in order.
    """
    key_type = np.uint16 if grid.count <= 1 << 16 else np.uint32

    def block_pairs(start: int) -> tuple[NDArray, NDArray]:
        ids = order[start : start + BLOCK_SIZE]
        with part("tiles of every splat"):
            tiles, owner = _pairs(splats, ids, grid)
        if open_tiles is not None:
            takes = open_tiles.take(tiles)
            tiles, owner = tiles.compress(takes), owner.compress(takes)
        return tiles.astype(key_type), ids.astype(np.int32).take(owner)

    blocks = run_jobs(block_pairs, range(0, order.size, BLOCK_SIZE))
    counts = sum(np.bincount(tiles, minlength=grid.count) for tiles, _ in blocks)
    lengths = -(-counts // BATCH)
    filled = np.repeat(np.arange(grid.count, dtype=key_type), BATCH * lengths - counts)
    blocks.append((filled, np.full(filled.size, splats.blank, np.int32)))
    tiles, ids = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return Pairs(ids.take(stable_argsort(tiles)).reshape(-1, BATCH), np.append(0, np.cumsum(lengths)))


@np.errstate(all="ignore")  # splats that reach to infinity
def _pairs(splats: Splats, ids: NDArray, grid: Grid) -> tuple[NDArray, NDArray]:
    """(tile, index into `ids`) for every tile in which a footprint may cover a pixel, in the order of `ids`."""
    spans = _spans(splats, ids)
    y, half_height = spans[Y], spans[HALF_HEIGHT]
    top, bottom = pixels_between(y - half_height, y + half_height, grid.height)
    top //= TILE_HEIGHT
    owner, row = _expand(top, bottom // TILE_HEIGHT - top + 1)
    low, high = _row_extent(spans[:HALF_HEIGHT].take(owner, axis=1), row, grid.width)
    first = low // TILE_WIDTH
    counts = high // TILE_WIDTH - first + 1
    counts[low > high] = 0
    entry, tile = _expand(row * np.int32(grid.columns) + first, counts)
    return tile, owner.take(entry)


def _spans(splats: Splats, ids: NDArray) -> NDArray:
    """(8, n) float32 what the chords of the footprints depend on, see `_row_extent`, and half their heights."""
    spans = np.empty((8, ids.size), np.float32)
    spans[: GAMMA + 1] = splats.records.take(ids, axis=0)[:, : GAMMA + 1].T
    _, _, alpha_x, beta_x, gamma = spans[: GAMMA + 1]
    tau = footprint_exponent(splats.log_opacities.take(ids))
    root, norm = np.sqrt(tau), np.sqrt(np.square(beta_x) + np.square(gamma))
    wide = np.flatnonzero(is_wide(norm / (alpha_x * gamma), 1 / gamma))
    spans[TAU], spans[HALF_HEIGHT], spans[Y_RIGHTMOST] = tau, root / gamma, -beta_x * root / (gamma * norm)
    spans[SLOPE], spans[REACH] = -beta_x / alpha_x, 1 / alpha_x  # in place of αx and βx
    if wide.size:
        # the chords of a needle this long are beyond float32, and its ends nearly: take whole rows, and rows to spare
        for plane, value in ((X, 0), (SLOPE, 0), (REACH, LIMIT), (Y_RIGHTMOST, 0)):
            spans[plane, wide] = value
        spans[TAU, wide] += WIDE_MARGIN
    return spans


def _expand(starts: NDArray, counts: NDArray) -> tuple[NDArray, NDArray]:
    """Ranges start … start + count − 1, one after the other: (index of the range, number), int32, per element."""
    owner = np.repeat(np.arange(counts.size, dtype=np.int32), counts)
    before = np.cumsum(counts, dtype=np.int32) - counts
    return owner, np.arange(owner.size, dtype=np.int32) + (starts - before).take(owner)


def _row_extent(spans: NDArray, row: NDArray, width: int) -> tuple[NDArray, NDArray]:
    """First and last pixel column of footprints within a row of tiles.

    The chord of the ellipse at dy is slope·dy ± reach·√(τ − (γ·dy)²). Its right end is concave in dy, so within a
    band of dy it is largest at the rightmost point of the whole ellipse, moved into the band; the left end mirrors.
    """
    x, y, slope, reach, gamma, tau, y_rightmost = spans
    low = (row * TILE_HEIGHT).astype(np.float32) + np.float32(0.5) - y
    high = low + np.float32(TILE_HEIGHT - 1)
    ends = []
    for sign in (-1, 1):
        dy = np.clip(sign * y_rightmost, low, high)
        half = np.sqrt(np.maximum(tau - np.square(gamma * dy), 0))
        ends.append(x + slope * dy + sign * (reach * half))
    return pixels_between(ends[0], ends[1], width)
