"""What loops are told of views and in which pieces tiles come."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import lists
from tinysplat_runtime.render.compiled import pack
from tinysplat_runtime.render.kernels_blend import Tiles
from tinysplat_runtime.render.lists import SplatBuffers, _batches, _grid, view_numbers
from tinysplat_runtime.render.prepare import parts
from tinysplat_runtime.render.project import View
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew


def view(width: int = 300, height: int = 70) -> View:
    c2w = np.array([[1.0, 0, 0, 7], [0, 1, 0, 8], [0, 0, 1, 9], [0, 0, 0, 1]])
    return View.of(Camera([[20.0, 3, 11], [0, 5, 12], [0, 0, 1]], c2w, width, height), np.array([1.0, 1, 1]), 0.25)


def test_a_view_s_numbers_by_hand() -> None:
    found = view_numbers(view(), -0.5)
    assert (found.offset, found.principal) == ((-6, -7, -8), (11, 12))
    assert found.least == pytest.approx((-45 - 11, -10.5 - 12)) and found.greatest == pytest.approx(
        (345 - 11, 80.5 - 12)
    )
    assert (found.right, found.down, found.ahead) == ((20, 3, 0), (0, 5, 0), (0, 0, 1))
    assert (found.near_plane, found.width, found.height, found.focal, found.log_share) == (0.25, 300, 70, 10, -0.5)
    assert view_numbers(view()).log_share == 0


@pytest.mark.parametrize(
    ("size", "columns", "count"),
    [((128, 32), 1, 1), ((129, 32), 2, 2), ((128, 33), 1, 2), ((300, 70), 3, 9), ((1, 1), 1, 1)],
)
def test_tiles_of_a_picture_overhang(size: tuple[int, int], columns: int, count: int) -> None:
    assert _grid(view(*size)) == Tiles(0, count, columns)


@pytest.mark.parametrize(
    ("counts", "limit", "ends"),
    [
        ([3, 3, 3], 6, [2, 3]),
        ([3, 3, 3], 5, [1, 2, 3]),
        ([9, 1, 1], 2, [1, 3]),
        ([0, 0, 5], 4, [2, 3]),
        ([4, 4], 8, [2]),
    ],
)
def test_batches_of_tiles_have_no_more_than_the_limit_or_are_alone(counts, limit, ends, monkeypatch) -> None:
    monkeypatch.setattr(lists, "MAX_KEYS", limit)
    found = list(_batches(np.array(counts)))
    assert [stop for _, stop in found] == ends and [first for first, _ in found] == [0, *ends[:-1]]


@pytest.mark.parametrize("limit", [10, 10**6])
def test_every_tile_is_worked_on_once_with_its_own_list_and_place(limit: int, monkeypatch) -> None:
    """Two parts of round Gaussians, each listed by the tiles that its footprint's box touches."""
    monkeypatch.setattr(lists, "MAX_KEYS", limit)
    rng, seen = np.random.default_rng(0), view()
    means = rng.uniform([2, -4, 10], [44, 41, 11], (40, 3))
    cloud = Gaussians(means, np.ones((40, 4)), np.full((40, 3), 0.4), np.full(40, 0.5), np.zeros((40, 1, 3)))
    (part,) = parts(cloud)
    keep = np.arange(40) < 25
    chunks = [pack(part, 0, keep), pack(part, 128, ~keep)]
    buffers = SplatBuffers(256, Crew(2).map)
    visible = [buffers.project(one, seen, 0.0, 0.25) for one in chunks]
    assert (buffers.records[:, 15] == 0.25).all()
    shown = np.concatenate([one.ids for one in visible])
    assert shown.size > 10 and (np.diff(shown) > 0).all()
    tiles, rows = {}, 0
    for part_of in buffers.lists(visible, seen):

        def note(tile, listed, extent, scratch, of=part_of) -> None:
            places = (listed.keys & np.uint64(0xFFFFFFFF)).astype(int)
            assert tile not in tiles and listed.scratch.shape == listed.keys.shape
            tiles[tile] = (sorted(of.rows[places].tolist()), tuple(extent))

        buffers.work_on(part_of, seen, note)
        rows += part_of.rows.size
        assert part_of.rows.size <= limit or part_of.tiles.stop - part_of.tiles.first == 1
    assert sorted(tiles) == list(range(9)) and rows == sum(len(listed) for listed, _ in tiles.values())
    for tile, (listed, extent) in tiles.items():
        row, column = tile // 3, tile % 3
        assert extent == (32 * row, 128 * column, min(32, 70 - 32 * row), min(128, 300 - 128 * column))
        left, right, top, bottom = (buffers.records[shown, at] for at in (10, 11, 12, 13))
        touches = (left // 128 <= column) & (column <= right // 128) & (top // 32 <= row) & (row <= bottom // 32)
        assert listed == shown[touches].tolist()
