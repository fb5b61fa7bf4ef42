"""Near views first: whose surface covers whose, that nothing jumps on the way from one to the other, and that of a
capture only what is near is drawn."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import make_cameras, make_gaussians

from tinysplat_runtime.render import Renderer, between, render
from tinysplat_runtime.render.near import NearViews
from tinysplat_runtime.scene.cameras import Camera


def test_gaussians_of_no_view_and_of_one_are_drawn_by_depth():
    for scene in (make_gaussians(3, 8, 12).flat(), make_gaussians(1, 8, 12)):
        camera = make_cameras(1, 8, 12)[0]
        np.testing.assert_array_equal(render(scene, camera), render(scene, camera, order="depth"))


def test_shares_are_1_for_the_nearest_view_and_0_for_those_far_away():
    views = NearViews.of(make_gaussians(4, 8, 12))
    path = between(make_cameras(4, 8, 12), 61)
    shares = np.stack([views.shares(camera).front for camera in path])
    assert (shares.max(axis=1) == 1).all() and (shares.min(axis=1) == 0).all()
    np.testing.assert_allclose(shares[30], shares[30][::-1], atol=1e-6)  # in the middle of the row


def row(distances, directions=None, depth=2.0):
    """Views along x, at these distances in depths from a camera at the origin, which is returned too."""
    centres = np.zeros((len(distances), 3))
    centres[:, 0] = depth * np.array(distances)
    directions = np.tile([0.0, 0, 1], (len(distances), 1)) if directions is None else np.array(directions)
    return NearViews(centres, directions, depth), Camera([[10.0, 0, 4], [0, 10, 4], [0, 0, 1]], np.eye(4), 8, 8)


@pytest.mark.parametrize("apart", [0.0, 0.3])
def test_cameras_at_one_place_are_told_apart_by_where_they_look(apart):
    """A tripod's, from its place and from beside it."""
    angles = 0.2 * np.arange(9)
    views, camera = row([apart] * 9, np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1))
    shares = views.shares(camera)
    assert shares.whole[0] == 1 and (np.diff(shares.whole[shares.whole > 0]) < 0).all()
    assert shares.whole[1] > 0 == shares.whole[-1] and np.isfinite(shares.front).all()


def test_a_photo_given_many_times_counts_once():
    once, camera = row([0.1, -0.2, 0.4, -0.5, 0.7, 3.0, -4.0])
    again, _ = row([0.1] * 6 + [-0.2] * 3 + [0.4, -0.5, 0.7, 3.0, -4.0])
    places = [0, 6, 9, 10, 11, 12, 13]
    np.testing.assert_array_equal(again.shares(camera).whole[places], once.shares(camera).whole)
    assert not np.delete(again.shares(camera).whole, places).any()
    assert again.shares(camera, without=[0]).whole[1] == 1
    same, camera = row([0.1] * 8)
    np.testing.assert_array_equal(same.shares(camera).whole, np.eye(8)[0])
    two, camera = row([0.1] * 5 + [0.12] * 5)  # two places are no capture
    np.testing.assert_array_equal(np.flatnonzero(two.shares(camera).whole), [0, 5])
    assert two.shares(camera).whole[5] == 1


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=8, max_size=8, unique=True), st.integers(0, 1000))
def test_shares_of_a_capture_are_continuous(places, seed):
    """From a camera to one a little beside it, no share changes by more than distances do against what R leaves."""
    views = NearViews(np.array(places), np.tile([0.0, 0, 1], (8, 1)), 1.0)
    start, towards = np.random.default_rng(seed).uniform(-1, 1, (2, 3))
    c2w = np.eye(4)
    c2w[:3, 3] = start
    shares, room = [], []
    for step in (0, 1e-6):
        c2w[:3, 3] = start + step * towards
        shares.append(views.shares(Camera(np.eye(3), c2w, 8, 8)).whole)
        distances = np.sort(np.linalg.norm(views.centres - c2w[:3, 3], axis=1))
        room.append(distances[4] - distances[0])
    assert np.abs(shares[1] - shares[0]).max() <= 4e-6 / min(room) + 1e-12


def test_a_frame_of_a_capture_takes_memory_for_the_near_views_alone():
    sizes = []
    for views in (8, 40):
        scene, camera = make_gaussians(views, 24, 32, degree=0), make_cameras(views, 24, 32)[0]
        renderer = Renderer(scene, 1, compiled=False)
        tracemalloc.start()
        renderer.render(camera)
        sizes.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert sizes[1] < 2 * sizes[0]
