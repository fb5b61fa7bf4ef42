"""The rasteriser under scenes and sizes at the end of what is possible: finite pictures, bounded memory, same bits."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from reference.rasteriser import render_reference

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.render import Renderer, lists, render, renderer
from tinysplat_runtime.render.prepare import parts, prepare
from tinysplat_runtime.render.project import Splats, View, may_show, project, projected
from tinysplat_runtime.render.tiles import Grid, bands, depth_order, find_pairs, runs
from tinysplat_runtime.scene.cameras import Camera

OUTPUTS = ("rgb", "depth", "alpha")
HUGE = np.finfo(np.float32).max
TINY = np.float32(1e-45)


def pinhole(height, width, focal=None):
    focal = focal or max(height, width)
    return Camera([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]], np.eye(4), width, height)


def cloud(count, seed=0, **fields):
    rng = np.random.default_rng(seed)
    default = {
        "means": rng.uniform(-1, 1, (count, 3)) * [1, 1, 0.5] + [0, 0, 2],
        "quats": rng.normal(size=(count, 4)),
        "scales": np.exp(rng.normal(size=(count, 3)) - 4),
        "opacities": rng.uniform(size=count),
        "sh": rng.normal(size=(count, 4, 3)) * 0.3,
    }
    return Gaussians(**{**default, **fields})


def assert_finite(images):
    for name, image in images.items():
        assert np.isfinite(image).all(), name
    assert images["rgb"].min() >= 0 and images["rgb"].max() <= 1
    assert images["alpha"].min() >= 0 and images["alpha"].max() <= 1
    assert images["depth"].min() >= 0


by_both = pytest.mark.parametrize("compiled", [False, True], ids=["numpy", "compiled"])


@by_both
@pytest.mark.parametrize(("height", "width"), [(300, 300), (40, 70), (1, 1)])
def test_pictures_are_bit_identical_for_any_number_of_threads(height, width, compiled):
    scene = cloud(40_000)
    images = [Renderer(scene, n, compiled=compiled).render(pinhole(height, width), outputs=OUTPUTS) for n in (1, 2, 3)]
    for other in images[1:]:
        for name in OUTPUTS:
            np.testing.assert_array_equal(images[0][name], other[name])


def test_pictures_do_not_depend_on_where_runs_are_cut(monkeypatch):
    scene = cloud(3000, scales=np.full((3000, 3), 0.03))
    whole = render(scene, pinhole(60, 80), outputs=OUTPUTS)
    for limit in (1, 5000):
        monkeypatch.setattr(renderer, "MAX_PAIRS", limit)
        cut = render(scene, pinhole(60, 80), outputs=OUTPUTS)
        for name in OUTPUTS:
            np.testing.assert_allclose(cut[name], whole[name], atol=1e-5)


def test_compiled_pictures_do_not_depend_on_where_batches_of_tiles_are_cut(monkeypatch):
    scene = cloud(3000, scales=np.full((3000, 3), 0.03))
    r = Renderer(scene, threads=2, compiled=True)
    whole = r.render(pinhole(150, 300), outputs=OUTPUTS)
    for limit in (1, 2000):
        monkeypatch.setattr(lists, "MAX_KEYS", limit)
        cut = r.render(pinhole(150, 300), outputs=OUTPUTS)
        for name in OUTPUTS:
            np.testing.assert_array_equal(cut[name], whole[name])


@by_both
def test_what_a_renderer_keeps_from_frame_to_frame_does_not_show(compiled):
    scene = cloud(20_000)
    r = Renderer(scene, threads=1, compiled=compiled)
    near, turn = pinhole(60, 80), np.eye(4)
    turn[:3, :3] = [[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]]
    aside = np.eye(4)
    aside[0, 3] = 0.2
    for c2w in (near.c2w, turn, aside, turn, near.c2w):
        camera = Camera(near.K, c2w, 80, 60)
        fresh = Renderer(scene, threads=1, compiled=compiled).render(camera, outputs=OUTPUTS)
        again = r.render(camera, outputs=OUTPUTS)
        for name in OUTPUTS:
            np.testing.assert_array_equal(again[name], fresh[name])


def test_compiled_frames_hold_records_of_what_they_show_alone():
    means = np.zeros((40_000, 3))
    means[:, 2] = np.where(np.arange(40_000) % 4 == 0, 3.0, -3.0)
    r = Renderer(cloud(40_000, means=means, opacities=np.full(40_000, 0.5)), threads=2, compiled=True)
    for _ in range(2):
        r.render(pinhole(60, 80))
        assert r._compiled._buffers._used == 10_000


@by_both
@pytest.mark.parametrize("scales", [(50.0, 50.0, 50.0), (50.0, 1e-3, 1e-3)], ids=["blobs", "needles"])
def test_memory_stays_bounded_when_every_gaussian_crosses_the_picture(scales, compiled):
    count = 5000
    scene = cloud(count, scales=np.tile(scales, (count, 1)), opacities=np.full(count, 0.006))
    camera = pinhole(128, 128)  # 1,024 tiles each: 5 million pairs
    r = Renderer(scene, threads=1, compiled=compiled)
    r.render(camera)  # compiles, where there is something to compile
    tracemalloc.start()
    image = r.render(camera, outputs=OUTPUTS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert_finite(image)
    assert peak < 150e6


def test_a_pile_of_gaussians_on_one_pixel_is_drawn_front_to_back():
    count = 100_000
    means = np.zeros((count, 3))
    means[:, 2] = np.linspace(5, 1, count)  # the last is in front
    scene = cloud(count, means=means, scales=np.full((count, 3), 1e-6), opacities=np.full(count, 0.01))
    image = render(scene, pinhole(9, 9), outputs=OUTPUTS)
    assert_finite(image)
    middle = image["depth"][4, 4]
    assert image["alpha"][4, 4] > 0.999
    assert 1 < middle < 1.01


def test_no_gaussians_in_sight_leave_the_background():
    behind = cloud(100, means=np.tile([0.0, 0, -2], (100, 1)))
    beside = cloud(100, means=np.tile([50.0, 0, 1], (100, 1)))
    clear = cloud(100, opacities=np.full(100, 0.003))
    for scene in (behind, beside, clear):
        image = render(scene, pinhole(20, 30), background=(0.1, 0.2, 0.3), outputs=OUTPUTS)
        np.testing.assert_array_equal(image["rgb"], np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (20, 30, 3)))
        assert not image["alpha"].any() and not image["depth"].any()


@pytest.mark.parametrize(
    "fields",
    [
        {"scales": np.full((200, 3), HUGE)},
        {"scales": np.full((200, 3), TINY)},
        {"scales": np.tile([HUGE, 0, TINY], (200, 1))},
        {"scales": np.tile([1e6, 1e-9, 1e-9], (200, 1))},
        {"means": np.full((200, 3), HUGE)},
        {"means": np.tile([HUGE, -HUGE, HUGE], (200, 1)), "scales": np.full((200, 3), HUGE)},
        {"means": np.tile([-HUGE, HUGE, 0.02], (200, 1)), "scales": np.full((200, 3), HUGE)},
        {"means": np.tile([0, 0, HUGE], (200, 1)), "scales": np.full((200, 3), 1e37)},
        {"means": np.full((200, 3), TINY)},
        {"quats": np.full((200, 4), TINY)},
        {"quats": np.full((200, 4), HUGE)},
        {"sh": np.full((200, 25, 3), HUGE)},
        {"sh": np.full((200, 25, 3), -HUGE)},
        {"sh": np.random.default_rng(0).choice([HUGE, -HUGE], (200, 16, 3))},
        {"opacities": np.ones(200)},
    ],
)
@pytest.mark.parametrize("near_plane", [0.01, 0.0])
@by_both
def test_numbers_at_the_end_of_float32_give_finite_pictures(fields, near_plane, compiled):
    drawn = Renderer(cloud(200, **fields), compiled=compiled)
    for camera in (pinhole(33, 47), Camera([[1e-3, 50, -300], [0, 1e6, 9e3], [0, 0, 1]], np.eye(4), 47, 33)):
        assert_finite(drawn.render(camera, outputs=OUTPUTS, near_plane=near_plane))


@by_both
def test_gaussians_never_checked_may_hold_nan_and_are_then_not_drawn(compiled):
    good = cloud(50)
    for name in ("means", "quats", "scales", "opacities", "sh"):
        fields = {n: getattr(good, n).copy() for n in ("means", "quats", "scales", "opacities", "sh")}
        fields[name][::2] = np.nan
        drawn = Renderer(Gaussians.unchecked(**fields), compiled=compiled)
        assert_finite(drawn.render(pinhole(20, 20), outputs=OUTPUTS))


EXTREME_SCENES = {
    "one pixel": (cloud(60, seed=1), pinhole(1, 1)),
    "a strip one row high": (cloud(60, seed=2), pinhole(1, 500, focal=400)),
    "a strip one column wide": (cloud(60, seed=3), pinhole(300, 1, focal=200)),
    "around and inside the Gaussians": (
        cloud(60, seed=4, means=np.random.default_rng(4).normal(size=(60, 3)) * 0.3, scales=np.full((60, 3), 0.5)),
        pinhole(20, 30),
    ),
    "on and through the near plane": (
        cloud(
            60,
            seed=5,
            means=np.stack([*np.random.default_rng(5).normal(size=(2, 60)) * 0.01, np.linspace(-0.01, 0.03, 60)], -1),
            scales=np.full((60, 3), 0.01),
        ),
        pinhole(20, 30),
    ),
    "covering the picture": (cloud(40, seed=6, scales=np.full((40, 3), 30.0)), pinhole(16, 24)),
    "smaller than a pixel": (cloud(300, seed=7, scales=np.full((300, 3), 1e-7)), pinhole(24, 24)),
    "needles": (cloud(80, seed=8, scales=np.tile([0.5, 1e-5, 1e-5], (80, 1))), pinhole(32, 32)),
    "all at one depth": (
        cloud(80, seed=9, means=np.random.default_rng(9).uniform(-1, 1, (80, 3)) * [1, 1, 0] + [0, 0, 2]),
        pinhole(24, 24),
    ),
    "opaque to the last ulp": (cloud(60, seed=10, opacities=np.nextafter(np.ones(60, np.float32), 0)), pinhole(24, 24)),
}


@pytest.mark.parametrize("name", EXTREME_SCENES)
def test_extreme_scenes_agree_with_float64(name):
    scene, camera = EXTREME_SCENES[name]
    found, wanted = render(scene, camera, outputs=OUTPUTS), render_reference(scene, camera)
    assert_finite(found)
    for output, bound in (("rgb", 1.0), ("alpha", 1.0)):
        error = np.abs(found[output] - np.clip(wanted[output], 0, 1))
        error = error.reshape(camera.height * camera.width, -1).max(axis=1)
        assert (error > 1e-4 * bound).sum() <= max(1, error.size // 100), (output, error.max())
        assert error.max() <= 1 / 255 + 1e-3


@pytest.mark.parametrize(("height", "width"), [(1, 7680), (4320, 1), (16, 7680)])
def test_strips_of_8k_are_the_same_whole_and_in_parts(height, width):
    scene = cloud(400, seed=11)
    whole = render(scene, pinhole(height, width, focal=600), outputs=OUTPUTS)
    assert_finite(whole)
    part = Camera(
        [[600, 0, width / 2 - width // 3], [0, 600, height / 2], [0, 0, 1]], np.eye(4), max(width // 3, 1), height
    )
    columns = slice(width // 3, width // 3 + part.width)
    error = np.abs(render(scene, part) - whole["rgb"][:, columns]).max(axis=-1)
    assert (error > 1e-4).mean() <= 0.01


def test_equal_depths_are_drawn_in_the_order_given_and_reversing_them_shows():
    means = np.tile([0.0, 0, 2.0], (2, 1))
    sh = np.zeros((2, 1, 3))
    sh[0, 0], sh[1, 0] = (1.5, -1.5, -1.5), (-1.5, 1.5, -1.5)
    both = cloud(2, means=means, sh=sh, scales=np.full((2, 3), 0.3), opacities=np.full(2, 0.9))
    middle = render(both, pinhole(9, 9))[4, 4]
    assert middle[0] > 5 * middle[1]
    other = cloud(2, means=means, sh=sh[::-1], scales=np.full((2, 3), 0.3), opacities=np.full(2, 0.9))
    assert render(other, pinhole(9, 9))[4, 4][1] > 5 * render(other, pinhole(9, 9))[4, 4][0]


def test_depth_order_is_by_depth_and_then_by_index():
    depths = np.float32([3, 1e-30, 2, 3, 1e30, 2, 0.5])
    np.testing.assert_array_equal(depth_order(depths, np.array([0, 1, 2, 3, 4, 5])), [1, 2, 5, 0, 3, 4])


def test_runs_hold_at_most_the_limit_or_one_splat():
    areas = np.array([5, 1, 1, 9, 3, 3, 100, 1])
    order = np.array([0, 1, 2, 3, 6, 4, 5, 7])
    cut = [order[run].tolist() for run in runs(areas.take(order), limit=8)]
    assert cut == [[0, 1, 2], [3], [6], [4, 5, 7]]


def _covered(covariance, centre, exponent, grid, aside):
    """Tiles of 4 × 4 pixels by hand: between the tile's first and last row of pixel centres, the ellipse meets a column
    of them, up to `aside` pixels to the left or right.
    """
    (a, b), (_, c) = np.linalg.inv(covariance)
    x = np.arange(grid.width)[:, None, None] + 0.5 - centre[0]
    y = 4 * np.arange(grid.rows)[:, None] + np.linspace(0.5, 3.5, 101) - centre[1]
    x = x + np.clip(-b / a * y - x, -aside, aside)  # to where the exponent is least, if that is within reach
    columns, rows = np.nonzero((0.5 * (a * x * x + 2 * b * x * y + c * y * y) <= exponent).any(axis=2))
    return set((rows * grid.columns + columns // 4).tolist())


def test_splats_are_listed_for_the_tiles_that_they_cover_and_for_no_others():
    """Every list in the order of drawing, and filled up to batches of eight with what has no opacity."""
    rng, grid, count = np.random.default_rng(3), Grid(61, 43), 40
    splats = Splats(count)
    covariances, centres = [], rng.uniform(-8, 68, (count, 2)) * [1, 0.7]
    splats.log_opacities[:count] = log_opacities = np.log(rng.uniform(0.1, 1, count))
    for n in range(count):
        a = np.diag(np.exp(rng.uniform(-0.5, 2.2, 2)))
        turn = np.array([[np.cos(n), -np.sin(n)], [np.sin(n), np.cos(n)]])
        sigma = turn @ a @ a @ turn.T
        covariances.append(sigma)
        alpha_x = np.sqrt(sigma[1, 1] / 2 / np.linalg.det(sigma))
        factors = alpha_x, -alpha_x * sigma[0, 1] / sigma[1, 1], np.sqrt(0.5 / sigma[1, 1])
        splats.records[n, :5] = *centres[n], *factors
    order = rng.permutation(count)
    pairs = find_pairs(splats, order, 0, grid, None)
    listed = [set() for _ in range(count)]
    for tile in range(grid.count):
        batches = pairs.batches[pairs.bounds[tile] : pairs.bounds[tile + 1]].ravel()
        rows = batches[batches != splats.blank]
        np.testing.assert_array_equal(rows, [n for n in order if n in set(rows.tolist())])
        assert len(batches) == -(-len(rows) // 8) * 8 and (batches[len(rows) :] == splats.blank).all()
        for n in rows:
            listed[n].add(tile)
    exponents = log_opacities + np.log(255)
    for n in range(count):
        least = _covered(covariances[n], centres[n], exponents[n] - 1e-3, grid, 0)
        most = _covered(covariances[n], centres[n], exponents[n] + 1e-3, grid, 0.05)
        assert least <= listed[n] <= most
    assert sum(map(len, listed)) > 500


def _needles(count, seed=3):
    """Splats of all sizes and slopes over 61×43 pixels and around them, nearest first."""
    rng, splats = np.random.default_rng(seed), Splats(count)
    a, c = np.exp(rng.uniform(-1, 4.4, (2, count)))
    b = rng.uniform(-0.95, 0.95, count) * np.sqrt(a * c)
    splats.records[:count, 0], splats.records[:count, 1] = rng.uniform(-8, 68, count), rng.uniform(-8, 50, count)
    splats.records[:count, 2] = alpha_x = np.sqrt(c / (2 * (a * c - b * b)))
    splats.records[:count, 3], splats.records[:count, 4] = -alpha_x * b / c, np.sqrt(0.5 / c)
    splats.log_opacities[:count] = np.log(rng.uniform(0.1, 1, count))
    return splats


def _lists(splats, pairs):
    """The numbers listed for every tile."""
    cut = [pairs.batches[a:b].ravel() for a, b in pairwise(pairs.bounds)]
    return [row[row != splats.blank].tolist() for row in cut]


def test_bands_list_what_the_whole_picture_lists():
    splats, order, whole = _needles(500), np.random.default_rng(1).permutation(500), Grid(61, 43)
    wanted = _lists(splats, find_pairs(splats, order, 0, whole, None))
    found = []
    for first, rows in ((0, 3), (3, 1), (4, 7)):
        grid = Grid(61, min(4 * (first + rows), 43) - 4 * first)
        found += _lists(splats, find_pairs(splats, order, first, grid, None))
    assert found == wanted and sum(map(len, found)) > 5000


def test_a_band_of_more_tiles_than_16_bits_count_lists_each_by_itself():
    splats, grid = Splats(2), Grid(4 * 70_000, 4)
    for n, tile in enumerate((69_000, 69_000 - (1 << 16))):
        splats.records[n, :5] = 4 * tile + 2, 2, 1, 0, 1
    splats.log_opacities[:2] = 0
    found = _lists(splats, find_pairs(splats, np.arange(2), 0, grid, None))
    assert found[69_000] == [0] and found[69_000 - (1 << 16)] == [1]


def test_tiles_that_are_closed_take_no_splats():
    splats, order, grid = _needles(300), np.arange(300), Grid(61, 43)
    is_open = np.random.default_rng(2).random(grid.count) < 0.5
    whole = _lists(splats, find_pairs(splats, order, 0, grid, None))
    found = _lists(splats, find_pairs(splats, order, 0, grid, is_open))
    assert found == [tile if takes else [] for tile, takes in zip(whole, is_open, strict=True)]


@pytest.mark.parametrize(
    ("width", "height", "pairs"), [(1, 1, 0), (256, 256, 10**6), (3840, 2160, 10**8), (5, 9999, 9)]
)
def test_bands_cover_every_row_once_and_are_neither_small_nor_large(width, height, pairs):
    found = bands(width, height, pairs)
    assert found[0][0] == 0 and sum(grid.height for _, grid in found) == height
    for (first, grid), (following, _) in pairwise(found):
        assert following == first + grid.rows and grid.height == 4 * grid.rows
    assert all(grid.width == width and grid.count <= 16_384 + grid.columns for _, grid in found)
    assert len(found) == 1 or min(grid.count for _, grid in found) >= 2048 - found[0][1].columns


def test_a_projected_block_names_the_splats_that_show_and_their_tiles_by_hand():
    camera = Camera([[40.0, 0, 16], [0, 40.0, 12], [0, 0, 1]], np.eye(4), 32, 24)
    means = [[0, 0, 2.0], [0, 0, -2.0], [0.4, 0, 2.0], [3.0, 0, 2.0], [0, 0, 0.05]]
    scene = cloud(
        5, means=np.array(means), scales=np.full((5, 3), 0.1), quats=np.tile([1.0, 0, 0, 0], (5, 1)),
        opacities=np.full(5, 0.5),
    )  # fmt: skip
    (block,) = prepare(scene)
    splats = Splats(5)
    view = View.of(camera, np.zeros(3), 0.1)
    np.testing.assert_array_equal(projected(block, view).visible, [0, 2])
    np.testing.assert_array_equal(project(block, view, (4, 4), splats), [0, 1])
    reach = np.sqrt(2 * np.log(0.5 * 255) * (2.0**2 + 0.3))  # of σ = 2 px and the dilation: 6.5 px
    for row, u in ((0, 16), (1, 24)):
        np.testing.assert_allclose(splats.records[row, :2], [u, 12], atol=1e-5)
        columns = [int(np.ceil(u - reach - 0.5)) // 4, min(int(np.floor(u + reach - 0.5)), 31) // 4]
        rows = [int(np.ceil(12 - reach - 0.5)) // 4, int(np.floor(12 + reach - 0.5)) // 4]
        np.testing.assert_array_equal(splats.boxes[:, row], [*rows, columns[1] - columns[0] + 1])
        assert splats.depths[row] == pytest.approx(2)
    assert project(block, View.of(camera, np.array([0, 0, -9.0]), 0.1), (4, 4), splats).size == 0


@pytest.mark.parametrize("length", [0.5, 50.0, 5e7, 5e20])
def test_the_exponent_of_needles_of_any_length_is_that_of_float64(length):
    """From 10 px to more than float32 has squares of: across it the dilation's 0.3 px² alone, along it hardly any."""
    camera = Camera([[40.0, 0, 16], [0, 40.0, 12], [0, 0, 1]], np.eye(4), 32, 24)
    turn = np.array([np.cos(np.pi / 12), 0, 0, np.sin(np.pi / 12)])
    needle = cloud(
        1, means=np.array([[0, 0, 2.0]]), quats=turn[None], scales=np.array([[length, 1e-6, 1e-6]]),
        opacities=np.array([0.9]),
    )  # fmt: skip
    (block,) = prepare(needle)
    splats = Splats(1)
    assert project(block, View.of(camera, np.zeros(3), 0.1), (4, 4), splats).size == 1
    alpha_x, beta_x, gamma = splats.records[0, 2:5].astype(np.float64)
    along, across = np.array([np.sqrt(0.75), 0.5]), np.array([-0.5, np.sqrt(0.75)])
    for t, s in ((0, 0), (10, 0), (-10, 1), (7, -2), (0, 3)):
        dx, dy = t * along + s * across
        found = (alpha_x * dx + beta_x * dy) ** 2 + (gamma * dy) ** 2
        wanted = 0.5 * (t**2 / ((20 * length) ** 2 + 0.3) + s**2 / 0.3)
        assert found == pytest.approx(wanted, rel=1e-4, abs=1e-5)


def _around(count, seed=0):
    """A cloud on all sides of the origin, with Gaussians from points to several units."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(count, 3)) * 4
    scales = np.exp(rng.uniform(-7, 1, (count, 3)))
    return cloud(count, means=means, scales=scales, quats=rng.normal(size=(count, 4)), opacities=rng.random(count))


@pytest.mark.parametrize("seed", range(6))
def test_nothing_that_shows_is_left_out_before_its_shape_is_known(seed):
    rng, scene = np.random.default_rng(seed), _around(8000, seed)
    K = [[rng.uniform(20, 300), rng.uniform(-5, 5), rng.uniform(-20, 90)], [0, rng.uniform(20, 300), 30], [0, 0, 1]]
    view = View.of(Camera(K, np.eye(4), 80, 60), np.zeros(3), 0.01)
    (part,) = parts(scene)
    found = may_show(part, view)
    (block,) = prepare(scene)
    shows = np.flatnonzero(scene.opacities >= 1 / 255)
    assert found[shows[projected(block, view).visible]].all()
    np.testing.assert_array_equal(may_show(block, view), found[shows])
    assert found.mean() < 0.8
    np.testing.assert_array_equal(may_show(part, view, 16), found[::16])


@pytest.mark.parametrize("order", ["near", "depth"])
def test_pictures_do_not_depend_on_what_is_kept_from_frame_to_frame(order, monkeypatch):
    views = tuple(pinhole(40, 60) for _ in range(2))
    grid = cloud(2 * 40 * 60, scales=np.full((2 * 40 * 60, 3), 0.02))
    arrays = {name: getattr(grid, name).reshape(2, 40, 60, *getattr(grid, name).shape[1:]) for name in FIELDS}
    for scene in (_around(40_000), Gaussians(**arrays, cameras=views)):
        kept = Renderer(scene, 2, order=order, compiled=False)
        frames = [kept.render(pinhole(60, 80), outputs=OUTPUTS) for _ in range(2)]
        frames.append(
            Renderer(scene, 1, order=order, compiled=False, keep=False).render(pinhole(60, 80), outputs=OUTPUTS)
        )
        with monkeypatch.context() as patch:
            patch.setattr(renderer, "KEPT_BYTES", 0)
            frames.append(Renderer(scene, 2, order=order, compiled=False).render(pinhole(60, 80), outputs=OUTPUTS))
        for name in OUTPUTS:
            assert all(np.array_equal(frames[0][name], other[name]) for other in frames[1:])


def test_one_picture_takes_memory_for_what_it_shows():
    scene, most = _around(150_000), {}
    for keep in (True, False):
        tracemalloc.start()
        Renderer(scene, 1, compiled=False, keep=keep).render(pinhole(60, 80))
        most[keep] = tracemalloc.get_traced_memory()[1] / scene.count
        tracemalloc.stop()
    assert most[False] < 0.75 * most[True] and most[False] < 300
