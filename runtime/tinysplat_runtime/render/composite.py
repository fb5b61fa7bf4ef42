"""Front to back: alphas of splats at pixels, blended in depth order with the exact stopping rule.

alpha = min(0.99, o·exp(−½ dᵀΣ₂⁻¹d)), skipped under 1/255; a splat that would bring a pixel's transmittance under 1e-4
is not blended and ends the pixel (Kerbl et al. 2023, and their rasteriser).

Work goes in groups of tiles whose lists are about equally long, a batch of splats of every tile at a time, as arrays
(splat, pixel row, pixel column, tile): many tiles to a numpy call, scratch arrays not much larger than a cache, and
what is the same for all pixels in one piece.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .prepare import ALPHA_MIN
from .project import BLUE, GAMMA, RECORD, RED, Splats
from .tiles import BATCH, TILE_HEIGHT, TILE_WIDTH, Pairs, TileGrid, in_batches

ALPHA_MAX = np.float32(0.99)
TRANSMITTANCE_MIN = np.float32(1e-4 * (1 - 2e-5))
"""1e-4, less what float32 may lose on the way: two splats of alpha 0.99, the most there is, leave exactly 1e-4, which
is enough, but 0.999998e-4 in float32."""

GROUP = 2048
"""Tiles composited together."""

PIXELS = TILE_HEIGHT * TILE_WIDTH

MAX_CHANGE = np.float32(80)
"""Cap of D in `_alphas`, which beside a footprint could overflow, and 0·∞ is no alpha."""

# Planes of `Canvas.state`
LEFT, STOPPED, SUMS = 0, 1, 2
N_COLOUR, N_DEPTH = 3, 2


class Canvas:
    """What every pixel has gathered.

    Attributes:
        colour: (H, W, 3) float32, what the splats add.
        left: (H, W) float32, what they let through.
        depth: (2, H, W) float32: Σ w·z and Σ w; (2, 0, 0) where none is gathered.
    """

    def __init__(self, height: int, width: int, with_depth: bool) -> None:
        self.colour = np.empty((height, width, N_COLOUR), np.float32)
        self.left = np.empty((height, width), np.float32)
        self.depth = np.empty((N_DEPTH, height, width) if with_depth else (N_DEPTH, 0, 0), np.float32)


class Band:
    """What the pixels of a band have gathered so far.

    Attributes:
        first_row: of its tiles.
        grid: its tiles.
        planes: 2 + 3 or 5 of a picture: transmittance left to later splats (0 once the pixel has stopped),
            transmittance at which it stopped (0 before), red, green, blue, and Σ w·z and Σ w where depth is gathered.
        state: (tiles, planes or 2·planes, 16) float32: the picture of everything, and the one before it, of what is
            drawn in front, where there is any. A tile's numbers lie together because tiles come and go in any order.
    """

    def __init__(self, first_row: int, grid: TileGrid, with_depth: bool, has_front: bool) -> None:
        self.first_row, self.grid, self.with_depth, self.has_front = first_row, grid, with_depth, has_front
        self.planes = SUMS + N_COLOUR + (N_DEPTH if with_depth else 0)
        self.state = np.zeros((grid.count, self.planes * (1 + has_front), PIXELS), np.float32)
        # pixels of the last tiles that lie outside the image start out stopped
        y, x = np.arange(grid.rows * TILE_HEIGHT) < grid.height, np.arange(grid.columns * TILE_WIDTH) < grid.width
        inside = (y[:, None] & x).reshape(grid.rows, TILE_HEIGHT, grid.columns, TILE_WIDTH)
        self.state[:, LEFT :: self.planes] = inside.swapaxes(1, 2).reshape(grid.count, 1, PIXELS)

    def open_tiles(self) -> NDArray:
        """(tiles,) bool: those with a pixel that has not stopped."""
        return self.state[:, LEFT :: self.planes].max(axis=(1, 2)) > 0

    def write(self, canvas: Canvas) -> None:
        """Hand over what was gathered."""
        rows = slice(self.first_row * TILE_HEIGHT, self.first_row * TILE_HEIGHT + self.grid.height)
        left, sums = self._picture(0)
        if self.has_front:
            through, before = self._picture(self.planes)
            left, sums = left * through, sums * through + before
        canvas.left[rows], sums = self._image(left)[..., 0], self._image(sums)
        canvas.colour[rows] = sums[..., :N_COLOUR]
        if self.with_depth:
            canvas.depth[:, rows] = np.moveaxis(sums[..., N_COLOUR:], -1, 0)

    def _picture(self, first: int) -> tuple[NDArray, NDArray]:
        """(tiles, 1, 16) transmittance and (tiles, 3 or 5, 16) sums of the picture whose planes begin there."""
        left = np.maximum(self.state[:, first + LEFT], self.state[:, first + STOPPED])
        return left[:, None], self.state[:, first + SUMS : first + self.planes]

    def _image(self, planes: NDArray) -> NDArray:
        """(tiles, k, 16) as an image (h, W, k)."""
        grid = self.grid
        fours = np.ascontiguousarray(planes).view(np.complex128)  # four pixels in a row are moved as one number
        fours = fours.reshape(grid.rows, grid.columns, -1, TILE_HEIGHT).transpose(2, 0, 3, 1)
        image = np.ascontiguousarray(fours).view(np.float32)
        image = image.reshape(-1, grid.rows * TILE_HEIGHT, grid.columns * TILE_WIDTH)
        return np.moveaxis(image[:, : grid.height, : grid.width], 0, -1)


class Workspace(threading.local):
    """Every thread's own scratch arrays: fresh memory costs more to touch than the arithmetic done in it."""

    def __init__(self) -> None:
        self.records = np.empty((BATCH * GROUP, RECORD), np.float32)
        self.planes = np.empty(RECORD * BATCH * GROUP, np.float32)
        self.change = np.empty(BATCH * TILE_WIDTH * GROUP, np.float32)
        self.alphas = np.empty(BATCH * PIXELS * GROUP, np.float32)
        # numpy has no fast path for the minimum of an array and a number
        self.max_change = np.full(GROUP, MAX_CHANGE)
        self.max_alpha = np.full(GROUP, ALPHA_MAX)
        self.fronts = np.empty(BATCH * PIXELS * GROUP, np.float32)
        self.shows = np.empty(BATCH * PIXELS * GROUP, np.bool_)


@dataclass(eq=False)
class _Lists:
    """The tiles of a group that are still at work, longest list first, and the centres of their first pixels."""

    tiles: NDArray
    starts: NDArray
    lengths: NDArray
    x: NDArray
    y: NDArray

    @classmethod
    def of(cls, band: Band, tiles: NDArray, starts: NDArray, lengths: NDArray) -> _Lists:
        row, column = np.divmod(tiles, band.grid.columns)
        x, y = ((n + 0.5).astype(np.float32) for n in (column * TILE_WIDTH, (row + band.first_row) * TILE_HEIGHT))
        return cls(tiles, starts, lengths, x, y)

    def compress(self, keep: NDArray) -> _Lists:
        return _Lists(*(array.compress(keep) for array in vars(self).values()))

    def after(self, done: int) -> _Lists:
        return _Lists(self.tiles, self.starts + done, self.lengths - done, self.x, self.y)


def tile_groups(pairs: Pairs) -> list[NDArray]:
    """Tiles (n,) intp that have splats, in groups of similar list length, longest first."""
    lengths = np.diff(pairs.bounds)
    by_length = np.argsort(-lengths, kind="stable")[: np.count_nonzero(lengths)]
    return [by_length[start : start + GROUP] for start in range(0, by_length.size, GROUP)]


def composite(band: Band, splats: Splats, pairs: Pairs, tiles: NDArray, work: Workspace) -> None:
    """Blend the lists of a group of a band's tiles, (n,) intp, longest first."""
    starts = pairs.bounds[tiles]
    lists = _Lists.of(band, tiles, starts, pairs.bounds[tiles + 1] - starts)
    rest = _walk(band, splats, pairs.batches, lists, work, only_front=False)
    if rest:
        _walk(band, splats, *_those_in_front(band, splats, pairs.batches, rest), work, only_front=True)


def _those_in_front(band: Band, splats: Splats, batches: NDArray, rest: list[_Lists]) -> tuple[NDArray, _Lists]:
    """Of what is left of lists, the splats of which something is drawn in front, and their lists, longest first."""
    tiles, starts, counts = (
        np.concatenate([getattr(part, name) for part in rest]) for name in ("tiles", "starts", "lengths")
    )
    owner = np.repeat(np.arange(tiles.size), counts)
    ids = batches.take(np.arange(owner.size) + (starts - (np.cumsum(counts) - counts)).take(owner), axis=0)
    shows = splats.fronts.take(ids) > 0
    pairs = in_batches(ids[shows], owner.repeat(shows.sum(axis=1)), tiles.size, splats.blank)
    longest_first = np.concatenate([np.zeros(0, np.int64), *tile_groups(pairs)])
    starts = pairs.bounds[longest_first]
    lengths = pairs.bounds[longest_first + 1] - starts
    return pairs.batches, _Lists.of(band, tiles[longest_first], starts, lengths)


def _walk(
    band: Band, splats: Splats, batches: NDArray, lists: _Lists, work: Workspace, only_front: bool
) -> list[_Lists]:
    """Blend lists, of which the longest come first, in both pictures or in the one in front.

    Returns:
        What is left of lists whose tiles are closed but for the picture in front.
    """
    rest: list[_Lists] = []
    tiles, done = lists.tiles, 0
    state = np.ascontiguousarray(np.moveaxis(band.state[tiles], 0, -1))  # (planes, 16, n)
    while tiles.size:
        n = np.count_nonzero(lists.lengths > done)  # lists only end, so those at work lead
        ids = np.ascontiguousarray(batches.take(lists.starts[:n] + done, axis=0).T)  # (8, n)
        planes = _planes(splats, ids, work)
        weights = _alphas(planes, splats.log_opacities.take(ids), lists.x[:n], lists.y[:n], work)
        before = _in_front(weights, splats.fronts.take(ids), work) if band.has_front else None
        depths = splats.depths.take(ids, mode="wrap") if band.with_depth else None
        some_stopped = False
        if not only_front:
            some_stopped = _blend(state[: band.planes, :, :n], weights, planes[RED : BLUE + 1], depths)
        if before is not None:
            some_stopped |= _blend(state[band.planes :, :, :n], before, planes[RED : BLUE + 1], depths)
        done += 1
        at_work = lists.lengths > done
        if some_stopped:
            at_work &= state[LEFT :: band.planes].any(axis=(0, 1))
            if band.has_front and not only_front:
                closed = at_work & ~state[LEFT].any(axis=0)
                if 4 * np.count_nonzero(closed) > at_work.size:
                    rest.append(lists.compress(closed).after(done))
                    at_work &= ~closed
        if 4 * np.count_nonzero(at_work) < 3 * at_work.size:  # dropping tiles costs about as much as a step
            leaving = ~at_work
            band.state[tiles.compress(leaving)] = np.ascontiguousarray(
                np.moveaxis(state.compress(leaving, axis=-1), -1, 0)
            )
            state, lists = state.compress(at_work, axis=-1), lists.compress(at_work)
            tiles = lists.tiles
    return rest


def _planes(splats: Splats, ids: NDArray, work: Workspace) -> NDArray:
    """(8, BATCH, n) records of the splats `ids`, planar.

    Picking whole records and turning them over takes half the time of picking from eight arrays, as it misses the
    cache once where they miss it eight times.
    """
    records = splats.records.take(ids.reshape(-1), axis=0, out=work.records[: ids.size], mode="wrap")
    planes = work.planes[: records.size].reshape(RECORD, ids.size)
    planes[:] = records.T
    return planes.reshape(RECORD, *ids.shape)


def _alphas(planes: NDArray, log_opacities: NDArray, first_x: NDArray, first_y: NDArray, work: Workspace) -> NDArray:
    """Alphas of splats at the pixels of their tiles, 0 where under 1/255.

    The exponent E = ln o − (αx·dx + βx·dy)² − (γ·dy)² is quadratic in dy. From one row of pixels to the next it
    changes by D, and D itself by a constant; so exp(E) of the later rows follows from the first by multiplication, and
    nine exponentials serve sixteen pixels. No pixel of a tile is further than 3√2 px from any other, so that where a
    footprint has a part in it, dilation keeps E above −62 and D below 19: float32 loses nothing by it.

    Args:
        planes: (8, BATCH, n) records.
        log_opacities: (BATCH, n).
        first_x: (n,) centre of each tile's first column of pixels.
        first_y: (n,) centre of its first row.
        work: holds the result until the next call.

    Returns:
        (BATCH, 16, n) float32.
    """
    n = planes.shape[-1]
    x, y, alpha_x, beta_x, gamma = planes[: GAMMA + 1]
    alphas = work.alphas[: PIXELS * BATCH * n].reshape(BATCH, TILE_HEIGHT, TILE_WIDTH, n)
    change = work.change[: TILE_WIDTH * BATCH * n].reshape(BATCH, TILE_WIDTH, n)
    dy = first_y - y
    with np.errstate(over="ignore"):  # in tiles beside a footprint
        across = alpha_x * (first_x - x) + beta_x * dy
        down = gamma * dy
        exponent = alphas[:, 0]  # (BATCH, 4 columns, n), of the first row
        exponent[:, 0] = across
        for column in range(1, TILE_WIDTH):
            np.add(exponent[:, column - 1], alpha_x, out=exponent[:, column])
        np.multiply(exponent, (-2 * beta_x)[:, None], out=change)
        steepness = np.square(beta_x) + np.square(gamma)
        np.subtract(change, (2 * gamma * down + steepness)[:, None], out=change)
        np.minimum(change, work.max_change[:n], out=change)
        np.square(exponent, out=exponent)
        np.subtract((log_opacities - np.square(down))[:, None], exponent, out=exponent)
        np.exp(exponent, out=exponent)
        np.exp(change, out=change)
        bend = np.exp(-2 * steepness)[:, None]
        np.multiply(exponent, change, out=alphas[:, 1])
        for row in range(2, TILE_HEIGHT):
            np.multiply(change, bend, out=change)
            np.multiply(alphas[:, row - 1], change, out=alphas[:, row])
    if log_opacities.max() > math.log(ALPHA_MAX):
        np.minimum(alphas, work.max_alpha[:n], out=alphas)
    shows = np.greater_equal(alphas, ALPHA_MIN, out=work.shows[: alphas.size].reshape(alphas.shape))
    np.multiply(alphas, shows, out=alphas)  # ten times as fast as any masked assignment
    return alphas.reshape(BATCH, PIXELS, n)


def _in_front(alphas: NDArray, fronts: NDArray, work: Workspace) -> NDArray | None:
    """Shares `fronts` (BATCH, n) of alphas (BATCH, 16, n), which are drawn in front; None where there are none."""
    if not fronts.any():
        return None
    return np.multiply(alphas, fronts[:, None], out=work.fronts[: alphas.size].reshape(alphas.shape))


def _blend(state: NDArray, weights: NDArray, colours: NDArray, depths: NDArray | None) -> bool:
    """Blend the next splats of each tile into its state.

    Args:
        state: (planes, 16, n), see `Canvas`; changed in place.
        weights: (BATCH, 16, n) alphas, which become weights.
        colours: (3, BATCH, n).
        depths: (BATCH, n) where depth is gathered.

    Returns:
        Whether a pixel has stopped.
    """
    before, left = state[LEFT], state[LEFT].copy()
    for weight in weights:
        np.multiply(weight, left, out=weight)
        np.subtract(left, weight, out=left)
    # A pixel stops once, so blend as if none did and mend the few that went below the limit.
    stopped = np.flatnonzero((left < TRANSMITTANCE_MIN) & (before > 0))
    if stopped.size:
        through = _mend(weights.reshape(BATCH, -1), before.take(stopped), stopped)
        left.reshape(-1)[stopped] = 0
        state[STOPPED][np.divmod(stopped, left.shape[1])] = through
    state[LEFT] = left
    # one sum for all colours takes half as long again
    for plane, colour in zip(state[SUMS:], colours, strict=False):
        plane += np.einsum("rpn,rn->pn", weights, colour)
    if depths is not None:
        state[SUMS + N_COLOUR] += np.einsum("rpn,rn->pn", weights, depths)
        state[SUMS + N_COLOUR + 1] += weights.sum(axis=0)
    return bool(stopped.size)


def _mend(weights: NDArray, path: NDArray, stopped: NDArray) -> NDArray:
    """Stop pixels where they should have: take later weights from them.

    Args:
        weights: (BATCH, pixels) of all pixels, changed in place.
        path: (k,) transmittance of those that stop, before the batch.
        stopped: (k,) which they are.

    Returns:
        (k,) transmittance at which they stop.
    """
    through, own = path, weights.take(stopped, axis=1)
    for weight in own:
        path = path - weight
        keeps = path >= TRANSMITTANCE_MIN
        weight *= keeps
        through = np.where(keeps, path, through)
    weights[:, stopped] = own
    return through
