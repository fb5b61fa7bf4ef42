"""Bands, runs and lists of tiles on numbers small enough to count."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.render.project import Splats
from tinysplat_runtime.render.tiles import Grid, bands, depth_order, find_pairs, in_batches, runs


def test_a_grid_s_last_tiles_overhang() -> None:
    for size, counts in (((1, 1), (1, 1)), ((4, 8), (1, 2)), ((5, 8), (2, 2)), ((8, 9), (2, 3)), ((61, 43), (16, 11))):
        grid = Grid(*size)
        assert (grid.columns, grid.rows) == counts and grid.count == counts[0] * counts[1]


@pytest.mark.parametrize(
    ("width", "height", "pairs", "count"),
    [
        (256, 256, 0, 2),  # 4,096 tiles: as many bands as have 2,048 each
        (256, 252, 0, 1),
        (1024, 1024, 0, 8),  # 65,536 tiles: eight bands, so that threads have something to share
        (1024, 1024, 4_000_000, 8),
        (1024, 1024, 4_000_001, 9),  # one for every half a million pairs
        (1024, 1024, 10**7, 20),
        (1024, 1024, 10**9, 32),  # but none of fewer than 2,048 tiles
        (2048, 2048, 0, 16),  # and none of more than 16,384
        (2048, 2052, 0, 17),
        (80_000, 4, 0, 1),  # unless one row has more
        (80_000, 8, 0, 2),
    ],
)
def test_bands_are_as_many_as_pairs_threads_and_numpy_s_calls_make_of_use(width, height, pairs, count) -> None:
    found, rows = bands(width, height, pairs), -(-height // 4)
    assert len(found) == count
    for n, (first, grid) in enumerate(found):  # even ones
        assert (first, grid.rows) == (rows * n // count, rows * (n + 1) // count - rows * n // count)
        assert grid.width == width and grid.height == min(4 * (first + grid.rows), height) - 4 * first


def test_depths_sort_by_all_of_their_bits() -> None:
    depths = np.float32(np.random.default_rng(0).permutation(1 << 12)) * np.float32(1.0001) + np.float32(0.5)
    depths[7] = depths[3000] = depths[5]
    order = depth_order(depths, np.arange(0, 1 << 12, 3, dtype=np.int32))
    np.testing.assert_array_equal(order, 3 * np.argsort(depths[::3], kind="stable"))


@pytest.mark.parametrize(
    ("areas", "limit", "ends"),
    [([3, 3, 3], 6, [2, 3]), ([3, 3, 3], 5, [1, 2, 3]), ([7, 1, 7], 7, [1, 2, 3]), ([0, 0, 9, 0], 1, [2, 3, 4]),
     ([], 5, []), ([9], 1, [1])],
)  # fmt: skip
def test_runs_end_where_the_next_would_be_too_much(areas, limit, ends) -> None:
    found = list(runs(np.array(areas, np.int64), limit))
    assert [run.stop for run in found] == ends and [run.start for run in found] == [0, *ends][: len(ends)]


def test_lists_are_filled_up_to_eights() -> None:
    counts = np.array([0, 3, 8, 9, 0, 1])
    found = in_batches(np.arange(21, dtype=np.int32), counts, 99)
    assert found.bounds.tolist() == [0, 0, 1, 2, 4, 4, 5]
    blank = [99] * 8
    rows = [[0, 1, 2, *blank[:5]], list(range(3, 11)), list(range(11, 19)), [19, *blank[:7]], [20, *blank[:7]]]
    assert found.batches.tolist() == rows and found.batches.dtype == np.int32


def test_splats_wider_than_float32_bears_take_whole_rows() -> None:
    """Half extents of √(2·ln 255) standard deviations: from 256 px per √τ on, chords are not looked for."""
    splats, grid = Splats(3), Grid(40, 64)
    splats.log_opacities[:3] = 0
    for n, (reach, gamma) in enumerate(((250.0, 0.5), (258.0, 0.5), (10.0, 1 / 300))):
        splats.records[n, :5] = 20, 30, 1 / reach, 0, gamma
    pairs = find_pairs(splats, np.arange(3, dtype=np.int32), 0, grid, None)
    listed = [set() for _ in range(3)]
    for tile in range(grid.count):
        for n in pairs.batches[pairs.bounds[tile] : pairs.bounds[tile + 1]].ravel():
            if n != splats.blank:
                listed[n].add(tile)
    half = np.sqrt(np.log(255)) / 0.5  # 4.71 px about row 30: 25.3 to 34.7, rows of tiles 6 to 8
    rows = range(int(30 - half) // 4, int(30 + half) // 4 + 1)
    assert listed[0] == listed[1] == {10 * row + column for row in rows for column in range(10)}
    assert listed[2] == set(range(grid.count))
