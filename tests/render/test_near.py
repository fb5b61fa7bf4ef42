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
    shares = np.stack([views.shares(camera) for camera in path])
    assert (shares.max(axis=1) == 1).all() and (shares.min(axis=1) == 0).all()
    np.testing.assert_allclose(shares[30], shares[30][::-1], atol=1e-6)  # in the middle of the row


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=2, max_size=9, unique=True), st.integers(0, 1000))
def test_shares_are_continuous(places, seed):
    """From a camera to one a little beside it, no share changes by more than distances do against what R leaves."""
    views = NearViews(np.array(places), np.tile([0.0, 0, 1], (len(places), 1)), 1.0)
    start, towards = np.random.default_rng(seed).uniform(-1, 1, (2, 3))
    c2w = np.eye(4)
    c2w[:3, 3] = start
    shares, room = [], []
    for step in (0, 1e-6):
        c2w[:3, 3] = start + step * towards
        shares.append(views.shares(Camera(np.eye(3), c2w, 8, 8)))
        distances = np.sort(np.linalg.norm(views.centres - c2w[:3, 3], axis=1))
        room.append(1.5 * distances[1] - distances[0])
    assert np.abs(shares[1] - shares[0]).max() <= 2e-5 / min(room) + 1e-12
