"""Which parts a picture reaches at all, and that those left out change none."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.render import prepare as prepare_module
from tinysplat_runtime.render import renderer as renderer_module
from tinysplat_runtime.render.prepare import parts, prepare
from tinysplat_runtime.render.project import (
    Splats,
    View,
    footprint_exponent,
    is_wide,
    jacobian_limits,
    may_show,
    parts_show,
    pixels_between,
    project,
)
from tinysplat_runtime.scene.cameras import Camera

BLOCK = 8


def clusters(count, seed=0):
    """Small clouds of a part each, all about the origin."""
    rng = np.random.default_rng(seed)
    places = np.repeat(rng.uniform(-9, 9, (count, 3)), BLOCK, axis=0)
    means = (places + 0.3 * rng.standard_normal(places.shape)).astype(np.float32)
    n = len(means)
    scales, quats = np.exp(rng.normal(-2, 0.7, (n, 3))), rng.standard_normal((n, 4))
    return Gaussians(means, quats, scales, rng.uniform(0.2, 0.9, n), rng.standard_normal((n, 1, 3)))


def looking(seed, width=40, height=30):
    """A camera anywhere in the clouds, its principal point aside."""
    rng, c2w = np.random.default_rng(seed), np.eye(4)
    c2w[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    c2w[:3, 2] *= np.sign(np.linalg.det(c2w[:3, :3]))
    c2w[:3, 3] = rng.uniform(-6, 6, 3)
    return Camera(np.array([[30, 1.5, 14], [0, 35, 19], [0, 0, 1]]), c2w, width, height)


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(prepare_module, "BLOCK_SIZE", BLOCK)
    monkeypatch.setattr(renderer_module, "MANY_PARTS", 2)


def test_parts_of_which_something_may_show_are_kept_and_most_others_left_out(small_blocks):
    cut, kept, needed = list(parts(clusters(150))), 0, 0
    for seed in range(12):
        view = View.of(looking(seed), np.zeros(3), 0.01)
        shows, wanted = parts_show(cut, view), np.array([may_show(part, view).any() for part in cut])
        assert not (wanted & ~shows).any()
        kept, needed = kept + shows.sum(), needed + wanted.sum()
    assert 200 < needed <= kept < 1.5 * needed


def test_parts_of_photos_reach_as_far_as_their_own_pixels(small_blocks):
    """A wall 3 away, whose photo's pixels are 25 of the picture's."""
    K, width, height = np.array([[16.0, 0, 12], [0, 16, 8], [0, 0, 1]]), 24, 16
    y, x = np.mgrid[:height, :width] + 0.5
    means = 3 * np.stack([x, y, np.ones_like(x)], axis=-1)[None] @ np.linalg.inv(K).T
    lead = means.shape[:3]
    scene = Gaussians(
        means, np.ones((*lead, 4)), np.full((*lead, 3), 1e-3), np.full(lead, 0.9), np.zeros((*lead, 1, 3)),
        (Camera(K, np.eye(4), width, height),),
    )  # fmt: skip
    cut = list(parts(scene, by_view=True))
    view = View.of(Camera(np.array([[400.0, 0, 20], [0, 400, 15], [0, 0, 1]]), np.eye(4), 40, 30), np.zeros(3), 0.01)
    shows, wanted = parts_show(cut, view), np.array([may_show(part, view).any() for part in cut])
    assert not (wanted & ~shows).any() and 0 < wanted.sum() <= shows.sum() < len(cut) / 2
    narrow = [part.bounds * [1, 1, 1, 1, 1, 1, 1, 0] for part in cut]
    assert (parts_show([SimpleNamespace(bounds=bounds) for bounds in narrow], view) < wanted).any()


@pytest.mark.parametrize("compiled", [False, True], ids=["numpy", "compiled"])
@pytest.mark.parametrize("keep", [True, False], ids=["kept", "for one frame"])
def test_leaving_parts_out_changes_no_picture(small_blocks, monkeypatch, compiled, keep):
    scene = clusters(60, seed=1)
    some = Renderer(scene, 2, compiled=compiled, keep=keep)
    pictures = [some.render(looking(seed)) for seed in range(6)]
    monkeypatch.setattr(renderer_module, "MANY_PARTS", 1 << 30)
    every = Renderer(scene, 1, compiled=compiled)
    for seed, picture in enumerate(pictures):
        np.testing.assert_array_equal(picture, every.render(looking(seed)))
    assert sum(picture.any() for picture in pictures) >= 3


@pytest.mark.parametrize("compiled", [False, True], ids=["numpy", "compiled"])
def test_a_picture_that_no_part_reaches_is_empty(small_blocks, compiled):
    scene, camera = clusters(10), looking(0)
    behind = replace(scene, means=scene.means * 0.01 + np.float32(camera.centre - 5 * camera.rotation[2]))
    assert not Renderer(behind, 1, compiled=compiled, keep=False).render(camera).any()


def test_one_compiled_frame_takes_memory_for_what_it_shows():
    rng, n = np.random.default_rng(0), 200_000
    means = rng.uniform(-1, 1, (n, 3)) * [40, 1, 1] + [0, 0, 3]  # of which a camera sees a twentieth
    scene = Gaussians(means, np.ones((n, 4)), np.full((n, 3), 0.01), np.full(n, 0.5), np.zeros((n, 1, 3)))
    camera, peaks = looking(0), []
    for keep in (True, False):
        Renderer(clusters(1), 1, compiled=True, keep=keep).render(camera)  # loads what is compiled
        tracemalloc.start()
        Renderer(scene, 1, compiled=True, keep=keep).render(Camera(camera.K, np.eye(4), 40, 30))
        peaks.append(tracemalloc.get_traced_memory()[1] / n)
        tracemalloc.stop()
    assert peaks[0] < 220 and peaks[1] < 40


def test_pixels_are_those_whose_centres_lie_between_and_a_little_around() -> None:
    """Widened by 1/64 px: a centre that lies as far outside is in, and one that lies farther is not."""
    low = np.float32([2.5, 2.515, 2.516, -9, 9.4, 9.6, 3.6, 0.4])
    high = np.float32([6.5, 6.485, 6.484, 99, 9.45, 99, 3.9, 0.45])
    first, last = pixels_between(low, high, 10)
    assert list(zip(first.tolist(), last.tolist(), strict=True))[:5] == [(2, 6), (2, 6), (3, 5), (0, 9), (9, 8)]
    assert first[5:8].tolist() == [10, 4, 0] and last[5:8].tolist() == [9, 3, -1]
    assert first.dtype == last.dtype == np.int32


def test_limits_of_the_jacobian_are_15_per_cent_of_the_picture_outside_it() -> None:
    view = View.of(Camera(np.array([[30, 1.5, 14], [0, 35, 19], [0, 0, 1]]), np.eye(4), 40, 30), np.zeros(3), 0.01)
    low, high = jacobian_limits(view)
    np.testing.assert_allclose(low, [-6 - 14, -4.5 - 19])
    np.testing.assert_allclose(high, [46 - 14, 34.5 - 19])
    np.testing.assert_allclose(view.projection, [[30, 1.5, 0], [0, 35, 0], [0, 0, 1]])
    away = np.array([[1.0, 0, 0, 3], [0, 1, 0, 4], [0, 0, 1, 5], [0, 0, 0, 1]])
    moved = View.of(Camera(view.camera.K, away, 40, 30), np.array([10.0, 20, 30]), 0.2)
    assert moved.offset.tolist() == [7, 16, 25] and moved.near_plane == 0.2


def test_a_footprint_ends_at_one_255th_and_is_wide_from_256_pixels_on() -> None:
    opacities = np.float32([1, 0.5, 1 / 255])
    np.testing.assert_allclose(footprint_exponent(np.log(opacities)), np.log(255 * opacities), atol=1e-6)
    width, height = np.float32([100, 156, 1, np.nan, 300]), np.float32([155.9, 100, 256, 1, np.inf])
    assert is_wide(width, height).tolist() == [False, True, True, True, True]


def longest_row(focal: float, principal: float, size: int) -> float:
    """Of (f, 0, −u) at the ends of the margin, for a camera without skew that is not turned."""
    return max(np.hypot(focal, end - principal) for end in (-0.15 * size, 1.15 * size))


@pytest.mark.parametrize("own", [None, 3.0], ids=["screen", "own"])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("largest", [0, 1, 2])
def test_gaussians_may_show_as_far_as_their_footprint_can_reach(axis, side, largest, own) -> None:
    """Half extents are at most √(2 ln 255) times the longest row of J·W by the largest scale and √0.3 pixels."""
    camera = Camera([[30.0, 0, 14], [0, 35, 19], [0, 0, 1]], np.eye(4), 40, 30)
    size, focal, principal = ((40, 30.0, 14), (30, 35.0, 19))[axis]
    z, scale = 2.0, 0.3
    widened = z if own is None else own * z
    extent = 1.001 * np.sqrt(2 * np.log(255)) * (longest_row(focal, principal, size) * scale + np.sqrt(0.3) * widened)
    edge = side * ((size / 2 + 1) * z + extent) + (size / 2 - principal) * z  # of (u − c)·z
    means, scales = np.zeros((1, 1, 2, 3)), np.full((1, 1, 2, 3), 0.01)
    means[..., 2] = z
    means[0, 0, :, axis] = (edge + np.array([-0.02, 0.02]) * side) / focal
    scales[..., largest] = scale
    photo = Camera([[camera.focal / (own or 1), 0, 1], [0, camera.focal / (own or 1), 1], [0, 0, 1]], np.eye(4), 2, 1)
    scene = Gaussians(means, np.ones((1, 1, 2, 4)), scales, np.ones((1, 1, 2)), np.zeros((1, 1, 2, 1, 3)), (photo,))
    view = View.of(camera, np.zeros(3), 0.01)
    (part,), (block,) = parts(scene, by_view=own is not None), prepare(scene, by_view=own is not None)
    for of in (part, block):
        assert may_show(of, view).tolist() == [True, False]
        assert may_show(of, view, 2).tolist() == [True]
        assert not may_show(of, View.of(camera, np.zeros(3), 2.0)).any()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_part_may_show_as_far_as_its_nearest_corner_can_reach(axis, side) -> None:
    """A box of Gaussians beside the picture, whose inner end is just near enough or just not."""
    camera = Camera([[30.0, 0, 14], [0, 35, 19], [0, 0, 1]], np.eye(4), 40, 30)
    size, focal, principal = ((40, 30.0, 14), (30, 35.0, 19))[axis]
    reach = 1.001 * np.sqrt(2 * np.log(255))
    view, found = View.of(camera, np.zeros(3), 0.01), []
    for past in (-0.02, 0.02):
        means, scales = np.zeros((4, 3)), np.full((4, 3), 0.01)
        z = np.array([2.0, 2, 5, 5])
        extent = reach * (longest_row(focal, principal, size) * 0.3 + np.sqrt(0.3) * z)
        edge = side * ((size / 2 + 1) * z + extent) + (size / 2 - principal) * z
        means[:, 2] = z
        means[:, axis] = side * max(side * (edge + side * past) / focal)  # outside of the farther end's edge
        means[1::2, axis] += 4 * side
        scales[3, 1] = 0.3
        of = Gaussians(means, np.ones((4, 4)), scales, np.ones(4), np.zeros((4, 1, 3)))
        found += parts_show(list(parts(of)), view).tolist()
        assert not parts_show(list(parts(of)), View.of(camera, np.zeros(3), 5.0)).any()
        assert not parts_show(list(parts(replace(of, means=-means))), view).any()
    assert found == [True, False]


@pytest.mark.parametrize("visible", [2, 5])
def test_colours_are_those_of_their_rows_however_many_show(visible: int) -> None:
    """Of eight, some before the camera: fewer than half are picked first. Below 0 a colour is 0."""
    means = np.zeros((8, 3))
    means[:, 2] = np.where(np.arange(8) % 8 < visible, 2, -2)
    sh = np.random.default_rng(0).normal(size=(8, 4, 3))
    sh[0, 0] = -9
    scene = Gaussians(means, np.ones((8, 4)), np.full((8, 3), 0.1), np.full(8, 0.5), sh)
    (block,) = prepare(scene)
    camera = Camera([[30.0, 0, 14], [0, 35, 19], [0, 0, 1]], np.eye(4), 40, 30)
    splats = Splats(20)
    rows = project(block, View.of(camera, np.zeros(3), 0.01), (4, 8), splats, first=7, front=0.25)
    assert rows.tolist() == list(range(7, 7 + visible)) and rows.dtype == np.int32
    c0, c1 = 0.28209479177387814, 0.4886025119029199  # seen along +z: the functions are C0, 0, C1, 0
    wanted = np.maximum(0.5 + c0 * sh[:visible, 0] + c1 * sh[:visible, 2], 0)
    np.testing.assert_allclose(splats.records[rows, 5:], wanted, atol=1e-6)
    np.testing.assert_allclose(splats.records[rows, :2], [[14, 19]] * visible, atol=1e-5)
    assert (splats.fronts[rows] == 0.25).all() and np.allclose(splats.depths[rows], 2)
    reach = np.sqrt(2 * np.log(0.5 * 255))  # deviations of 1.5² + 0.3 and 1.75² + 0.3 px²
    across, down = reach * np.sqrt(1.5**2 + 0.3), reach * np.sqrt(1.75**2 + 0.3)
    top, bottom = int(np.ceil(18.5 - down)) // 8, int(18.5 + down) // 8
    columns = int(13.5 + across) // 4 - int(np.ceil(13.5 - across)) // 4 + 1
    np.testing.assert_array_equal(splats.boxes[:, rows], [[top] * visible, [bottom] * visible, [columns] * visible])


def test_the_splat_that_fills_lists_up_has_no_opacity() -> None:
    splats = Splats(3)
    assert splats.blank == splats.count == 3 and splats.records.shape == (4, 8)
    assert splats.log_opacities[3] == -np.inf and splats.fronts[3] == splats.depths[3] == 0
    assert not splats.records[3].any() and splats.boxes.shape == (3, 3)
