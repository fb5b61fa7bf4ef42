"""Near views first: whose surface covers whose, and that nothing jumps on the way from one to the other."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scenes import make_cameras, make_gaussians

from tinysplat_runtime.render import between, render
from tinysplat_runtime.render.near import NearViews
from tinysplat_runtime.scene.cameras import Camera


def test_gaussians_of_no_view_and_of_one_are_drawn_by_depth():
    for scene in (make_gaussians(3, 8, 12).flat(), make_gaussians(1, 8, 12)):
        camera = make_cameras(1, 8, 12)[0]
        np.testing.assert_array_equal(render(scene, camera), render(scene, camera, order="depth"))


def test_shares_are_1_for_the_nearest_view_and_0_for_those_far_away():
    views = NearViews.of(make_gaussians(4, 8, 12))
    path = between(make_cameras(4, 8, 12), 61)
    fronts, left = np.stack([views.shares(camera) for camera in path], axis=1)
    assert (fronts.max(axis=1) == 1).all() and (fronts.min(axis=1) == 0).all() and (left == 1).all()
    np.testing.assert_allclose(fronts[30], fronts[30][::-1], atol=1e-6)  # in the middle of the row


def test_of_many_views_a_picture_shows_six_at_most():
    _, left = NearViews.of(make_gaussians(9, 8, 12)).shares(make_cameras(9, 8, 12)[2])
    assert (left[[1, 2, 3]] == 1).sum() >= 2 and np.count_nonzero(left) <= 6


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=2, max_size=9, unique=True), st.integers(0, 1000))
def test_shares_are_continuous(places, seed):
    """From a camera to one a little beside it, no share changes by more than distances do against what R leaves."""
    views = NearViews(np.array(places), np.tile([0.0, 0, 1], (len(places), 1)), 1.0)
    start, towards = np.random.default_rng(seed).uniform(-1, 1, (2, 3))
    c2w = np.eye(4)
    c2w[:3, 3] = start
    fronts, left, room = [], [], []
    for step in (0, 1e-6):
        c2w[:3, 3] = start + step * towards
        for found, by_view in zip((fronts, left), views.shares(Camera(np.eye(3), c2w, 8, 8)), strict=True):
            found.append(by_view)
        distances = np.sort(np.linalg.norm(views.centres - c2w[:3, 3], axis=1))
        room.append([1.5 * distances[1] - distances[0], *(distances[6:7] - distances[1])])
    for found, least in zip((fronts, left), np.min(room, axis=0), strict=False):
        assert np.abs(found[1] - found[0]).max() <= 2e-5 / max(least, 1e-30) + 1e-12
