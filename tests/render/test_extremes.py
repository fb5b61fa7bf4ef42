"""The rasteriser under scenes and sizes at the end of what is possible: finite pictures, bounded memory, same bits."""

import tracemalloc

import numpy as np
import pytest

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer, render
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


@by_both
@pytest.mark.parametrize("scales", [(50.0, 50.0, 50.0), (50.0, 1e-3, 1e-3)], ids=["blobs", "needles"])
def test_memory_stays_bounded_when_every_gaussian_crosses_the_picture(scales, compiled):
    count, peaks = 5000, []
    scene = cloud(count, scales=np.tile(scales, (count, 1)), opacities=np.full(count, 0.006))
    r = Renderer(scene, threads=1, compiled=compiled)
    for side in (64, 128):  # the larger picture has four times the pairs of a Gaussian and a pixel
        r.render(pinhole(side, side))  # compiles, where there is something to compile
        tracemalloc.start()
        assert_finite(r.render(pinhole(side, side), outputs=OUTPUTS))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2 * peaks[0]


def test_a_pile_of_gaussians_on_one_pixel_is_drawn_front_to_back():
    count = 30_000
    means = np.zeros((count, 3))
    means[:, 2] = np.linspace(5, 1, count)  # the last is in front
    scene = cloud(count, means=means, scales=np.full((count, 3), 1e-6), opacities=np.full(count, 0.01))
    image = render(scene, pinhole(9, 9), outputs=OUTPUTS)
    assert_finite(image)
    middle = image["depth"][4, 4]
    assert image["alpha"][4, 4] > 0.999
    assert 1 < middle < 1.02


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


def _around(count, seed=0):
    """A cloud on all sides of the origin, with Gaussians from points to several units."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(count, 3)) * 4
    scales = np.exp(rng.uniform(-7, 1, (count, 3)))
    return cloud(count, means=means, scales=scales, quats=rng.normal(size=(count, 4)), opacities=rng.random(count))


def test_one_picture_takes_memory_for_what_it_shows():
    scene, most = _around(150_000), {}
    for keep in (True, False):
        tracemalloc.start()
        Renderer(scene, 1, compiled=False, keep=keep).render(pinhole(60, 80))
        most[keep] = tracemalloc.get_traced_memory()[1] / scene.count
        tracemalloc.stop()
    assert most[False] < most[True]
