"""Near views first: whose surface covers whose, and that nothing jumps on the way from one to the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_cameras, make_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer, between, render
from tinysplat_runtime.render.near import NearViews
from tinysplat_runtime.scene.cameras import Camera

C0 = 0.28209479177387814


def walls(depths, colours, height=16, width=20):
    """One opaque wall of a colour per view, each at its own depth."""
    cameras = make_cameras(len(depths), height, width)
    y, x = np.mgrid[:height, :width] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    means = [d * (pixels @ np.linalg.inv(c.K).T) @ c.rotation + c.centre for d, c in zip(depths, cameras, strict=True)]
    lead = (len(depths), height, width)
    sh = np.broadcast_to((np.array(colours, float) - 0.5)[:, None, None, None] / C0, (*lead, 1, 3))
    scales = np.broadcast_to(np.array(depths)[:, None, None, None] / (1.1 * width), (*lead, 3))
    quats = np.broadcast_to([1.0, 0, 0, 0], (*lead, 4))
    return Gaussians(np.stack(means), quats, scales, np.full(lead, 0.95), sh, cameras)


RED, GREEN, BLUE = np.eye(3)


def centre(image):
    return image[image.shape[0] // 2, image.shape[1] // 2]


@pytest.mark.parametrize("compiled", [False, True], ids=["numpy", "compiled"])
def test_a_near_view_covers_wrong_surfaces_before_its_own(compiled):
    scene = walls([3.0, 2.0, 2.5], [RED, GREEN, BLUE])
    for view, colour in enumerate((RED, GREEN, BLUE)):
        image = Renderer(scene, 1, compiled=compiled).render(scene.cameras[view])
        assert centre(image) @ colour > 0.4
    by_depth = Renderer(scene, 1, order="depth", compiled=compiled).render(scene.cameras[0])
    assert centre(by_depth) @ RED < 0.01


def test_further_layers_are_never_drawn_first():
    surface, behind = walls([3.0, 2.5], [RED, GREEN]), walls([3.0, 2.0], [RED, GREEN])
    hidden = replace(surface, opacities=np.zeros_like(surface.opacities), extra_layers=(behind,))
    camera = surface.cameras[0]
    np.testing.assert_array_equal(render(hidden, camera), render(hidden, camera, order="depth"))


def test_gaussians_of_no_view_and_of_one_are_drawn_by_depth():
    for scene in (make_gaussians(3, 8, 12).flat(), make_gaussians(1, 8, 12)):
        camera = make_cameras(1, 8, 12)[0]
        np.testing.assert_array_equal(render(scene, camera), render(scene, camera, order="depth"))


def test_shares_are_1_for_the_nearest_view_and_reach_0_before_the_third():
    views = NearViews.of(make_gaussians(4, 8, 12))
    path = between(make_cameras(4, 8, 12), 61)
    shares = np.stack([views.shares(camera) for camera in path])
    assert (shares.max(axis=1) == 1).all() and shares.min() == 0
    assert (np.count_nonzero(shares > 0, axis=1) <= 3).all()
    np.testing.assert_allclose(shares[30], shares[30][::-1], atol=1e-9)  # in the middle of the row


def test_shares_move_by_no_more_than_the_camera_does():
    views = NearViews.of(make_gaussians(4, 8, 12))
    cameras = make_cameras(4, 8, 12)
    coarse, fine = (
        np.abs(np.diff([views.shares(camera) for camera in between(cameras, frames)], axis=0)).max()
        for frames in (151, 1501)
    )
    assert fine < coarse / 5


def test_a_camera_that_turns_to_another_view_s_subject_counts_as_near_it():
    views = NearViews.of(make_gaussians(2, 8, 12))
    a, b = make_cameras(2, 8, 12)
    turned = a.c2w.copy()
    turned[:3, :3] = b.c2w[:3, :3]
    towards, straight = (views.shares(Camera(a.K, c2w, 12, 8)) for c2w in (turned, a.c2w))
    assert towards[1] > straight[1]


def test_views_at_one_place_are_drawn_first_where_the_camera_is():
    gaussians = make_gaussians(2, 8, 12)
    same = gaussians.with_cameras([gaussians.cameras[0]] * 2)
    np.testing.assert_array_equal(NearViews.of(same).shares(same.cameras[0]), [1, 1])


@pytest.mark.parametrize(("option", "value"), [("order", "far"), ("dilation", 0.3)])
def test_options_that_are_none_are_refused_by_name(option, value):
    with pytest.raises(InputError, match=option):
        render(make_gaussians(2, 8, 12), make_cameras(1, 8, 12)[0], **{option: value})


def test_the_views_depth_is_the_harmonic_mean_of_what_lies_before_them():
    scene = make_gaussians(2, 8, 12)
    depths = [((m - c.centre) @ c.c2w[:3, 2]) for m, c in zip(scene.means, scene.cameras, strict=True)]
    found = NearViews.of(scene)
    assert found.depth == pytest.approx(1 / np.mean(1 / np.array(depths)), rel=1e-6)
    behind = replace(scene, means=2 * np.stack([c.centre for c in scene.cameras])[:, None, None] - scene.means)
    assert NearViews.of(behind).depth == 1
    np.testing.assert_allclose(found.centres, [camera.centre for camera in scene.cameras])
    np.testing.assert_allclose(found.directions, [camera.c2w[:3, 2] for camera in scene.cameras])


def test_shares_by_hand():
    """Distances of 0.3, 0.5 and 0.6 depths: R = 0.75, and of what is left to it a third and a ninth, squared."""
    places = [(-0.6, 0, 0), (0, 1.0, 0), (0, 0, 1.2)]
    views = NearViews(np.array(places), np.tile([0.0, 0, 1], (3, 1)), 2.0)
    camera = Camera([[10.0, 0, 4], [0, 10, 4], [0, 0, 1]], np.eye(4), 8, 8)
    wanted = [1, ((0.75 - 0.5) / 0.45) ** 2, ((0.75 - 0.6) / 0.45) ** 2]
    np.testing.assert_allclose(views.shares(camera), wanted, atol=1e-12)
    aside = replace(views, directions=np.array([[0, 0, 1.0], [0, 0.6, 0.8], [0, 0, 1]]))
    distance = np.hypot(0.5, np.sqrt(0.6**2 + 0.2**2))  # of the second, which looks elsewhere
    reach = 1.5 * 0.6
    assert distance < reach
    wanted = [1, ((reach - distance) / (reach - 0.3)) ** 2, ((reach - 0.6) / (reach - 0.3)) ** 2]
    np.testing.assert_allclose(aside.shares(camera), wanted, atol=1e-12)
