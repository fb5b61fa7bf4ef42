"""Lists, sorts and blends of compiled drawing, each by itself on numbers that can be worked out."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("numba")

from tinysplat_runtime.render import kernels_blend as kb
from tinysplat_runtime.render import kernels_project as kp
from tinysplat_runtime.render.kernels_blend import Extent, Listed, Picture, Scratch, Tiles, Visible


@pytest.mark.parametrize("count", [1, 7, 255, 256, 2047, 2048, 5000])
@pytest.mark.parametrize("spread", [1, 40, 1 << 31])
def test_keys_are_sorted_by_their_upper_half_and_ties_stay(count: int, spread: int) -> None:
    rng = np.random.default_rng(count)
    depths = rng.integers(0, spread, count, dtype=np.uint64) + np.uint64(123)
    keys = depths << np.uint64(32) | np.arange(count, dtype=np.uint64)[::-1]
    wanted = keys[np.argsort(depths, kind="stable")]
    found = kb.sort_by_depth(keys.copy(), np.empty_like(keys), np.empty(kb.DIGITS, np.int64))
    np.testing.assert_array_equal(found, wanted)


def test_powers_of_e_are_right_to_two_units_in_the_last_place() -> None:
    x = np.concatenate([np.linspace(-80, 88, 4001), np.linspace(-1, 1, 401)]).astype(np.float32)
    found = np.array([kb.quick_exp(value) for value in x], np.float64)
    np.testing.assert_allclose(found, np.exp(x.astype(np.float64)), rtol=2.5e-7)


def test_boxes_and_chords_are_cut_to_their_tile() -> None:
    splat = np.zeros(16, np.float32)
    splat[[kp.LEFT, kp.RIGHT, kp.TOP, kp.BOTTOM]] = 100, 300, 20, 70
    assert kb.box(splat, Extent(32, 128, 32, 128)) == (0, 127, 32, 63)
    assert kb.box(splat, Extent(64, 256, 32, 44)) == (0, 43, 64, 70)
    assert kb.box(splat, Extent(0, 0, 32, 128)) == (100, 127, 20, 31)
    # centres from 3.5 to 7.5, and a 64th around them
    for middle, half, columns, wanted in ((5.5, 2.0, 20, (3, 7)), (5.5, 1.99, 20, (3, 7)), (5.5, 1.98, 20, (4, 6)),
                                          (1.0, 9.0, 5, (0, 4)), (18.2, 3.0, 20, (15, 19))):  # fmt: skip
        assert kb.chord(np.float32(middle), np.float32(half), columns) == wanted


def lists_of(boxes: np.ndarray, columns: int, first: int, stop: int) -> list[list[int]]:
    """By brute force: the rows whose box holds each tile."""

    def reaches(box: np.ndarray, tile: int) -> bool:
        left, right, top, bottom = box
        return bool(left <= tile % columns <= right and top <= tile // columns <= bottom)

    return [[n for n, box in enumerate(boxes) if reaches(box, tile)] for tile in range(first, stop)]


def test_what_is_visible_is_listed_by_the_tiles_that_it_reaches() -> None:
    rng, columns, tile_rows, count = np.random.default_rng(0), 4, 5, 40
    low, high = rng.integers(0, [[4 * 128], [5 * 32]], (2, count)), rng.integers(0, [[4 * 128], [5 * 32]], (2, count))
    records = np.zeros((count, 16), np.float32)
    records[:, kp.LEFT], records[:, kp.TOP] = np.minimum(low, high)
    records[:, kp.RIGHT], records[:, kp.BOTTOM] = np.maximum(low, high)
    records[::7, kp.RIGHT] = -1
    records[:, kp.DEPTH] = rng.uniform(0.1, 9, count)
    found = Visible(
        np.zeros(count, np.int32), np.zeros((count, 4), np.int16), np.full(columns * tile_rows, 9, np.int64)
    )
    shown = kb.list_visible(records, 100, columns, found)
    visible = np.flatnonzero(records[:, kp.RIGHT] >= 0)
    assert shown == visible.size and found.ids[:shown].tolist() == (100 + visible).tolist()
    boxes = (records[visible][:, [kp.LEFT, kp.RIGHT, kp.TOP, kp.BOTTOM]] // [128, 128, 32, 32]).astype(int)
    np.testing.assert_array_equal(found.boxes[:shown], boxes)
    every = lists_of(boxes, columns, 0, columns * tile_rows)
    assert found.counts.tolist() == [len(tile) for tile in every]
    whole = np.concatenate([np.zeros((100, 16), np.float32), records])
    for first, stop in ((0, 20), (6, 7), (3, 14), (17, 20)):
        tiles, sizes = Tiles(first, stop, columns), [len(tile) for tile in every[first:stop]]
        starts = np.cumsum([0, *sizes])
        ends, total = starts[:-1].copy(), int(starts[-1])
        keys, rows = np.zeros(total, np.uint64), np.zeros(total, np.int32)
        kb.list_by_tile(whole, Visible(found.ids[:shown], found.boxes[:shown], found.counts), tiles, ends, keys, rows)
        np.testing.assert_array_equal(ends, starts[1:])
        assert rows.tolist() == [int(100 + visible[n]) for tile in every[first:stop] for n in tile]
        np.testing.assert_array_equal(keys & np.uint64(0xFFFFFFFF), np.arange(total))
        np.testing.assert_array_equal((keys >> np.uint64(32)).astype(np.uint32).view(np.float32), whole[rows, kp.DEPTH])


def splats(count: int, seed: int, extent: Extent) -> np.ndarray:
    """Records of splats about a tile; of the wide ones rows are cut to their chord."""
    rng, records = np.random.default_rng(seed), np.zeros((count, 16), np.float32)
    a, c = np.exp(rng.uniform(0.5, 5, (2, count)))
    b = rng.uniform(-0.8, 0.8, count) * np.sqrt(a * c)
    records[:, kp.X] = extent.column + rng.uniform(-3, extent.columns + 3, count)
    records[:, kp.Y] = extent.row + rng.uniform(-3, extent.rows + 3, count)
    records[:, kp.ALPHA_X] = np.sqrt(c / (2 * (a * c - b * b)))
    records[:, kp.BETA_X], records[:, kp.GAMMA] = -records[:, kp.ALPHA_X] * b / c, np.sqrt(0.5 / c)
    records[:, kp.LOG_OPACITY] = np.log(rng.uniform(0.1, 1, count))
    records[:, kp.RED : kp.BLUE + 1] = rng.uniform(0, 1.5, (count, 3))
    records[:, kp.DEPTH] = rng.permutation(count) + 1.0
    root = np.sqrt(2 * (records[:, kp.LOG_OPACITY] + math.log(255)))
    for axis, variance, low, high in ((kp.X, a, kp.LEFT, kp.RIGHT), (kp.Y, c, kp.TOP, kp.BOTTOM)):
        reach = root * np.sqrt(variance)
        records[:, low] = np.ceil(np.maximum(records[:, axis] - reach - 0.52, 0))
        records[:, high] = np.floor(records[:, axis] + reach - 0.48)
    records[:, kp.REACH] = np.where(records[:, kp.RIGHT] - records[:, kp.LEFT] >= 16, 1 / records[:, kp.ALPHA_X], 0)
    records[:, kp.LAST] = np.where(np.arange(count) % 3 == 0, rng.uniform(0, 1, count), 0)
    return records


def blended(records: np.ndarray, extent: Extent, shares: np.ndarray) -> np.ndarray:
    """(rows, columns, 5) float64 red, green, blue, Σ w·z and transmittance, pixel by pixel as 3DGS defines it."""
    y, x = np.mgrid[: extent.rows, : extent.columns] + 0.5
    out = np.zeros((extent.rows, extent.columns, 5))
    left, is_open = np.ones(x.shape), np.ones(x.shape, bool)
    for n in np.argsort(records[:, kp.DEPTH]):
        mean_x, mean_y, alpha_x, beta_x, gamma, log_opacity = records[n, :6].astype(np.float64)
        dx, dy = x + extent.column - mean_x, y + extent.row - mean_y
        alpha = np.exp(log_opacity - (alpha_x * dx + beta_x * dy) ** 2 - (gamma * dy) ** 2)
        alpha = np.where(alpha >= 1 / 255, shares[n] * np.minimum(alpha, 0.99), 0)
        is_open &= (left * (1 - alpha) >= 1e-4 * (1 - 2e-5)) | (alpha == 0)
        weight = np.where(is_open, left * alpha, 0)
        out[..., :3] += weight[..., None] * records[n, kp.RED : kp.BLUE + 1]
        out[..., 3] += weight * records[n, kp.DEPTH]
        left = left - weight
    out[..., 4] = left
    return out


@pytest.mark.parametrize("has_front", [False, True])
@pytest.mark.parametrize(
    ("count", "extent"), [(60, Extent(64, 128, 13, 21)), (700, Extent(32, 0, 32, 128)), (3, Extent(0, 256, 1, 1))]
)
def test_a_tile_is_blended_front_to_back_as_pixels_are(count: int, extent: Extent, has_front: bool) -> None:
    records = splats(count, count, extent)
    order = np.random.default_rng(1).permutation(count)
    bits = records[order, kp.DEPTH].view(np.uint32).astype(np.uint64)
    keys = bits << np.uint64(32) | np.arange(count, dtype=np.uint64)
    work = Scratch(np.empty(kb.STATE, np.float32), np.empty((kb.AHEAD, 16), np.float32), np.empty(kb.DIGITS, np.int64))
    shape = (extent.row + extent.rows + 2, extent.column + extent.columns + 3)
    picture = Picture(np.full((*shape, 3), 7, np.float32), np.full(shape, 7, np.float32), np.full(shape, 7, np.float32))
    kb.composite_tile(
        records, order.astype(np.int32), Listed(keys, np.empty_like(keys)), extent, work, picture, has_front
    )
    wanted = blended(records, extent, np.ones(count))
    if has_front:
        front = blended(records, extent, records[:, kp.LAST].astype(np.float64))
        wanted[..., :4] = front[..., :4] + front[..., 4:] * wanted[..., :4]
        wanted[..., 4] *= front[..., 4]
    own = np.s_[extent.row : extent.row + extent.rows, extent.column : extent.column + extent.columns]
    for found, part, atol in ((picture.colour[own], wanted[..., :3], 2e-4), (picture.left[own], wanted[..., 4], 1e-4),
                              (picture.depth[own], wanted[..., 3], 2e-4 * count)):  # fmt: skip
        error = np.abs(found - part) > atol
        assert error.mean() < 0.004 and np.abs(found - part).max() < 100 * atol  # where rounding decides a threshold
    assert wanted[..., 4].min() < 0.3
    outside = np.ones(shape, bool)
    outside[own] = False
    assert (picture.left[outside] == 7).all() and (picture.colour[outside] == 7).all()
    plain = Picture(picture.colour, picture.left, np.empty((0, 0), np.float32))
    before = picture.colour.copy()
    kb.composite_tile(
        records, order.astype(np.int32), Listed(keys, np.empty_like(keys)), extent, work, plain, has_front
    )
    np.testing.assert_array_equal(plain.colour, before)


def test_a_tile_is_open_while_any_pixel_lets_something_through() -> None:
    state = np.zeros(kb.STATE, np.float32)
    assert not kb.is_open(state)
    state[:] = -0.5  # all have stopped
    assert not kb.is_open(state)
    for row, column in ((0, 0), (31, 127), (7, 64)):
        state[row * kb.ROW + column] = 1e-4
        assert kb.is_open(state)
        state[row * kb.ROW + column] = -1e-4
    state[128] = 1  # behind the last column, where vectors may end
    assert not kb.is_open(state)


def test_an_open_tile_is_blended_to_its_end() -> None:
    """Seven hundred faint splats, none of which stops a pixel, and a thousand of which the first stop all."""
    extent = Extent(0, 0, 8, 8)
    for count, log_opacity, left in ((700, np.log(0.006), None), (1000, np.log(0.9), 1e-4)):
        records = np.zeros((count, 16), np.float32)
        records[:, [kp.X, kp.Y]], records[:, [kp.ALPHA_X, kp.GAMMA]] = 4, 1e-4
        records[:, kp.LOG_OPACITY], records[:, kp.RED] = log_opacity, np.arange(count) / count
        records[:, [kp.RIGHT, kp.BOTTOM]], records[:, kp.DEPTH] = 7, np.arange(count) + 1
        keys = records[:, kp.DEPTH].copy().view(np.uint32).astype(np.uint64) << np.uint64(32) | np.arange(
            count, dtype=np.uint64
        )
        work = Scratch(
            np.empty(kb.STATE, np.float32), np.empty((kb.AHEAD, 16), np.float32), np.empty(kb.DIGITS, np.int64)
        )
        rows = np.arange(count, dtype=np.int32)
        _, looked_at = kb.blend_tile(records, rows, Listed(keys, np.empty_like(keys)), extent, work, False)
        alpha = np.exp(log_opacity)
        if left is None:
            assert looked_at == count
            weights = alpha * (1 - alpha) ** np.arange(count)
            assert work.state[0] == pytest.approx((1 - alpha) ** count, rel=1e-3)
            red = work.state[kb.ROW // 10]
            assert red == pytest.approx((weights * records[:, kp.RED]).sum(), rel=1e-3)
        else:
            assert looked_at == kb.AHEAD and -2 * left < work.state[0] * 1.0 < 0
