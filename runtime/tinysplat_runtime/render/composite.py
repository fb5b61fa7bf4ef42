"""Front to back: alphas of splats at pixels, blended in depth order with the exact stopping rule.

alpha = min(0.99, o·exp(−½ dᵀΣ₂⁻¹d)), skipped under 1/255; a splat that would bring a pixel's transmittance under 1e-4
is not blended and ends the pixel (Kerbl et al. 2023, and their rasteriser).

Work goes in groups of tiles whose lists are about equally long, a few ranks of every list at a time, as arrays
(rank, pixel row, pixel column, tile): thousands of tiles to a numpy call and a working set that fits the L2 cache.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .prepare import ALPHA_MIN
from .project import ALPHA_X, BETA_X, DEPTH, GAMMA, LOG_OPACITY, RED, Splats, X, Y
from .tiles import TILE, Grid, Pairs

ALPHA_MAX = 0.99
TRANSMITTANCE_MIN = 1e-4

GROUP = 2048
"""Tiles composited together."""

RANKS = 8
"""Splats of each tile composited together."""

PIXELS = TILE * TILE

_ALPHA_MIN_BITS = np.float32(ALPHA_MIN).view(np.int32)

# Rows of `Canvas.state`
LEFT, STOPPED, SUMS = 0, 1, 2
N_COLOUR, N_DEPTH = 3, 2


class Canvas:
    """What every pixel has gathered so far.

    Attributes:
        grid: the tiles.
        with_depth: whether depth is gathered.
        state: (2 + 3 or 5, 16, tiles) float32: transmittance left to later splats (0 once the pixel has stopped),
            transmittance at which it stopped (0 before), red, green, blue, and Σ w·z and Σ w where depth is gathered.
    """

    def __init__(self, grid: Grid, with_depth: bool) -> None:
        self.grid = grid
        self.with_depth = with_depth
        planes = SUMS + N_COLOUR + (N_DEPTH if with_depth else 0)
        self.state = np.zeros((planes, PIXELS, grid.count), np.float32)
        # pixels of the last tiles that lie outside the image start out stopped
        y, x = np.arange(grid.rows * TILE) < grid.height, np.arange(grid.columns * TILE) < grid.width
        inside = (y[:, None] & x).reshape(grid.rows, TILE, grid.columns, TILE)
        self.state[LEFT] = inside.transpose(1, 3, 0, 2).reshape(PIXELS, grid.count)

    def open_tiles(self) -> NDArray:
        """(tiles,) bool: those with a pixel that has not stopped."""
        return self.state[LEFT].any(axis=0)

    def image(self, planes: slice) -> NDArray:
        """Rows `planes` of the state as an image (H, W, planes)."""
        grid = self.grid
        picture = self.state[planes].reshape(-1, TILE, TILE, grid.rows, grid.columns).transpose(3, 1, 4, 2, 0)
        picture = picture.reshape(grid.rows * TILE, grid.columns * TILE, -1)
        return picture[: grid.height, : grid.width]

    def transmittance(self) -> NDArray:
        """(H, W) what the splats let through."""
        return self.image(slice(LEFT, STOPPED + 1)).max(axis=-1)


@dataclass(eq=False)
class _Lists:
    """The tiles of a group still at work, longest list first."""

    tiles: NDArray
    starts: NDArray
    lengths: NDArray
    centre_x: NDArray
    centre_y: NDArray

    def __getitem__(self, which: slice | NDArray) -> _Lists:
        return _Lists(*(array[which] for array in vars(self).values()))


class Workspace:
    """Scratch arrays of one thread, so that no step touches fresh memory."""

    def __init__(self) -> None:
        self.alphas = np.empty(RANKS * PIXELS * GROUP, np.float32)
        self.scratch = np.empty(RANKS * PIXELS * GROUP, np.float32)


def tile_groups(pairs: Pairs) -> list[NDArray]:
    """Tiles that have splats, in groups of similar list length, longest first."""
    lengths = np.diff(pairs.bounds)
    by_length = np.argsort(-lengths, kind="stable")[: np.count_nonzero(lengths)]
    return [by_length[start : start + GROUP] for start in range(0, by_length.size, GROUP)]


def composite(canvas: Canvas, splats: Splats, pairs: Pairs, tiles: NDArray, work: Workspace) -> None:
    """Blend the lists of a group of tiles, longest first, into the canvas."""
    grid = canvas.grid
    starts = pairs.bounds[tiles]
    row, column = np.divmod(tiles, grid.columns)
    half = np.float32(TILE / 2)
    lists = _Lists(
        tiles, starts, pairs.bounds[tiles + 1] - starts,
        (column * TILE).astype(np.float32) + half, (row * TILE).astype(np.float32) + half,
    )  # fmt: skip
    state = canvas.state.take(tiles, axis=-1)  # C order, which indexing would not give
    rank = 0
    while lists.tiles.size:
        n = np.count_nonzero(lists.lengths > rank)  # lists only end, so those at work lead
        ids = _ids(pairs, lists[:n], rank, splats.planes.shape[1] - 1)
        weights = _alphas(splats, ids, lists, work)
        if _blend(state[:, :, :n], weights, splats, ids, canvas.with_depth):
            at_work = state[LEFT].any(axis=0)
        else:
            at_work = np.ones(lists.tiles.size, bool)
        rank += RANKS
        at_work &= lists.lengths > rank
        if 4 * np.count_nonzero(at_work) < 3 * at_work.size:
            canvas.state[:, :, lists.tiles[~at_work]] = state[:, :, ~at_work]
            state, lists = state.compress(at_work, axis=-1), lists[at_work]
        elif not (lists.lengths > rank).any():
            break
    canvas.state[:, :, lists.tiles] = state


def _ids(pairs: Pairs, lists: _Lists, rank: int, blank: int) -> NDArray:
    """(RANKS, n) columns of the next splats of each list, `blank` past a list's end."""
    ranks = np.arange(rank, rank + RANKS)[:, None]
    ids = pairs.splats.take(lists.starts + ranks, mode="clip").astype(np.int64)
    if lists.lengths[-1] < rank + RANKS:
        ids[ranks >= lists.lengths] = blank
    return ids


def _alphas(splats: Splats, ids: NDArray, lists: _Lists, work: Workspace) -> NDArray:
    """(RANKS, 16, n) alphas of the splats `ids` (RANKS, n) at the pixels of their tiles, 0 where under 1/255.

    The exponent is a square that depends on x and y plus one that depends on y alone (see `project`), so all but
    three operations run on a quarter of the pixels or on none.
    """
    n = ids.shape[1]
    x, y, alpha_x, beta_x, gamma, log_opacity = (
        splats.planes[i].take(ids) for i in (X, Y, ALPHA_X, BETA_X, GAMMA, LOG_OPACITY)
    )
    steps = (np.arange(TILE, dtype=np.float32) - np.float32((TILE - 1) / 2))[:, None]
    dx, dy = lists.centre_x[:n] - x, lists.centre_y[:n] - y
    with np.errstate(over="ignore"):  # far outside a footprint
        across = (alpha_x * dx)[:, None] + alpha_x[:, None] * steps  # (RANKS, 4 columns, n)
        down = (beta_x * dy)[:, None] + beta_x[:, None] * steps  # (RANKS, 4 rows, n)
        along_y = log_opacity[:, None] - np.square((gamma * dy)[:, None] + gamma[:, None] * steps)
        alphas = work.alphas[: RANKS * PIXELS * n].reshape(RANKS, TILE, TILE, n)
        np.add(down[:, :, None], across[:, None], out=alphas)
        np.square(alphas, out=alphas)
        np.subtract(along_y[:, :, None], alphas, out=alphas)
        np.exp(alphas, out=alphas)
    if log_opacity.max() > math.log(ALPHA_MAX):
        np.minimum(alphas, np.float32(ALPHA_MAX), out=alphas)
    # Positive floats compare like their bits. An arithmetic shift of a difference's sign makes the mask, at a third
    # of the cost of a boolean one.
    bits = alphas.view(np.int32)
    mask = work.scratch.view(np.int32)[: bits.size].reshape(bits.shape)
    np.subtract(_ALPHA_MIN_BITS - 1, bits, out=mask)
    np.right_shift(mask, 31, out=mask)
    np.bitwise_and(bits, mask, out=bits)
    return alphas.reshape(RANKS, PIXELS, n)


def _blend(state: NDArray, weights: NDArray, splats: Splats, ids: NDArray, with_depth: bool) -> bool:
    """Blend `weights` (RANKS, 16, n), alphas that become weights, into the state; True if a pixel has stopped."""
    left = state[LEFT]
    before = left.copy()
    for weight in weights:
        np.multiply(weight, left, out=weight)
        np.subtract(left, weight, out=left)
    # Stopping is rare, so blend as if there were none and mend the pixels that went below.
    stopped = np.flatnonzero((left < np.float32(TRANSMITTANCE_MIN)) & (before > 0))
    if stopped.size:
        flat = weights.reshape(RANKS, -1)
        path = np.subtract.accumulate(np.concatenate([before.reshape(1, -1)[:, stopped], flat[:, stopped]]))
        kept = path >= np.float32(TRANSMITTANCE_MIN)
        flat[:, stopped] *= kept[1:]
        pixel, tile = np.divmod(stopped, left.shape[1])
        state[STOPPED, pixel, tile] = np.where(kept, path, 1).min(axis=0)
        left[pixel, tile] = 0
    for channel in range(N_COLOUR):
        state[SUMS + channel] += np.einsum("rpn,rn->pn", weights, splats.planes[RED + channel].take(ids))
    if with_depth:
        state[SUMS + N_COLOUR] += np.einsum("rpn,rn->pn", weights, splats.planes[DEPTH].take(ids))
        state[SUMS + N_COLOUR + 1] += weights.sum(axis=0)
    return bool(stopped.size)
