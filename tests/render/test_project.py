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
from tinysplat_runtime.render.prepare import parts
from tinysplat_runtime.render.project import View, may_show, parts_show
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
