"""Which splats reach which tile, in depth order.

A tile is 4×4 pixels: small enough that a good part of its pixels lies inside the footprints listed for it. Splats are
expanded in depth order to the tiles that they reach, and a stable sort by tile leaves every tile's list in depth order.
Sorts are stable ones of 16 bits, which numpy does digit by digit: a fifth of the time of any other that it has.

A picture is made in bands of rows of tiles, each for itself: what is listed at a time is bounded by the band, and bands
are what threads share. Where a band alone has too many pairs, its splats go through in runs of falling nearness, and
tiles whose pixels have all stopped take no further pairs.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .prepare import BLOCK_SIZE
from .project import GAMMA, LIMIT, Splats, X, Y, footprint_exponent, is_wide, pixels_between

TILE_WIDTH, TILE_HEIGHT = 4, 4
"""Pixels."""

BATCH = 8
"""Splats of a tile that are composited at a time."""

MAX_PAIRS = 1_000_000
"""Most (tile, splat) pairs listed at a time, unless one splat alone has more; while they are sorted, a pair takes about
40 bytes."""

RADIX_TILES = 1 << 16
"""Tiles of a band that 16 bits tell apart."""

BAND_PAIRS = MAX_PAIRS // 2
"""Pairs that a band should have, as most of them then go through at once."""

BAND, LEAST_BAND = 16_384, 2048
"""Most and fewest tiles of a band, unless one row has more or the picture fewer: numpy's calls cost as much for a few
tiles as for many."""

LEAST_BANDS = 8
"""Of pictures large enough, so that threads have something to share."""

WIDE_MARGIN = 0.05
"""Exponent by which the footprints of wide splats are enlarged for the search for their tiles."""

# Planes of `_spans`; the first, second and fifth are those of `Splats.records`
SLOPE, REACH, TAU, Y_RIGHTMOST, HALF_HEIGHT = 2, 3, 5, 6, 7


@dataclass(frozen=True)
class TileGrid:
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
    """The splats of every tile in the order of drawing.

    Attributes:
        batches: (M, 8) int32, numbers of `Splats`, one tile after the other. A tile's last batch is filled up with the
            one that has no opacity.
        bounds: (tiles + 1,) int64, where each tile's list starts in `batches`.
    """

    batches: NDArray
    bounds: NDArray


def bands(width: int, height: int, pairs: int) -> list[tuple[int, TileGrid]]:
    """First row of tiles and tiles of every band of a picture that has about so many (tile, splat) pairs.

    No pixel depends on where it is cut but for the rounding of sums.
    """
    whole = TileGrid(width, height)
    wanted = max(-(-pairs // BAND_PAIRS), LEAST_BANDS)
    count = min(max(-(-whole.count // BAND), min(whole.count // LEAST_BAND, wanted), 1), whole.rows)
    edges = [whole.rows * n // count for n in range(count + 1)]
    ends = [min(edge * TILE_HEIGHT, height) for edge in edges]
    return [(edges[n], TileGrid(width, ends[n + 1] - ends[n])) for n in range(count)]


def depth_order(depths: NDArray, ids: NDArray) -> NDArray:
    """`ids` (R,) int32, which rise, by depth, ties as they were. Positive floats sort like their bits."""
    bits = depths.take(ids).view(np.uint32)
    by_low = np.argsort(bits.astype(np.uint16), kind="stable")
    by_high = np.argsort((bits >> np.uint32(16)).astype(np.uint16).take(by_low), kind="stable")
    return ids.take(by_low.take(by_high))


def runs(areas: NDArray, limit: int) -> Iterator[slice]:
    """Cut `areas` (R,) integer into runs that sum to at most `limit`, or of a single one."""
    ends = np.cumsum(areas, dtype=np.int64)
    start, done = 0, 0
    while start < areas.size:
        stop = max(int(np.searchsorted(ends, done + limit, side="right")), start + 1)
        yield slice(start, stop)
        start, done = stop, int(ends[stop - 1])


def find_pairs(splats: Splats, order: NDArray, first_row: int, grid: TileGrid, open_tiles: NDArray | None) -> Pairs:
    """List the tiles of a band that a run of splats reaches.

    Args:
        splats: the frame's splats.
        order: (R,) int32 rows of the run's splats, nearest first.
        first_row: of the band's tiles.
        grid: the band's tiles.
        open_tiles: (tiles,) bool, which tiles still take splats; None for all.
    """
    tile_type = np.uint16 if grid.count <= RADIX_TILES else np.uint32
    blocks = []
    for start in range(0, order.size, BLOCK_SIZE):
        ids = order[start : start + BLOCK_SIZE]
        tiles, owner = _pairs(splats, ids, first_row, grid)
        if open_tiles is not None:
            takes = open_tiles.take(tiles)
            tiles, owner = tiles.compress(takes), owner.compress(takes)
        blocks.append((tiles.astype(tile_type), ids.take(owner)))
    tiles, ids = (np.concatenate(arrays) for arrays in zip(*blocks, strict=True))
    return in_batches(ids, tiles, grid.count, splats.blank)


def in_batches(ids: NDArray, tiles: NDArray, count: int, blank: int) -> Pairs:
    """Lists of `count` tiles: those of `ids` (M,) int32 that have its number in `tiles` (M,), uint16 where that holds
    them, as they follow each other. Each is filled up to whole batches, by pairs that a stable sort leaves at its end.
    """
    counts = np.bincount(tiles, minlength=count)
    tiles = np.concatenate([tiles, np.repeat(np.arange(count, dtype=tiles.dtype), -counts % BATCH)])
    ids = np.concatenate([ids, np.full(tiles.size - ids.size, blank, np.int32)])
    batches = ids.take(np.argsort(tiles, kind="stable")).reshape(-1, BATCH)
    return Pairs(batches, np.append(0, np.cumsum(-(-counts // BATCH))))


@np.errstate(all="ignore")  # splats that reach to infinity
def _pairs(splats: Splats, ids: NDArray, first_row: int, grid: TileGrid) -> tuple[NDArray, NDArray]:
    """(tile, index into `ids`) for every tile in which a footprint may cover a pixel, in the order of `ids`."""
    spans = _spans(splats, ids)
    y, half_height = spans[Y], spans[HALF_HEIGHT]
    first_y = first_row * TILE_HEIGHT
    top, bottom = pixels_between(y - half_height, y + half_height, first_y + grid.height)
    top = np.maximum(top, first_y) // TILE_HEIGHT
    owner, row = _expand(top, np.maximum(bottom // TILE_HEIGHT - top + 1, 0))
    low, high = _row_extent(spans[:HALF_HEIGHT].take(owner, axis=1), row, grid.width)
    first = low // TILE_WIDTH
    counts = high // TILE_WIDTH - first + 1
    counts[low > high] = 0
    entry, tile = _expand((row - np.int32(first_row)) * np.int32(grid.columns) + first, counts)
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
        dy = np.minimum(np.maximum(sign * y_rightmost, low), high)  # `clip` takes four times as long
        half = np.sqrt(np.maximum(tau - np.square(gamma * dy), 0))
        ends.append(x + slope * dy + sign * (reach * half))
    return pixels_between(ends[0], ends[1], width)
