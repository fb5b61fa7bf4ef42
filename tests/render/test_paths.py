"""Camera paths pass through what they were given, turn evenly and stay rigid."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scenes import make_list

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.render import between, orbit
from tinysplat_runtime.render.paths import outside, ring
from tinysplat_runtime.scene.cameras import Camera


def camera(quat=(1.0, 0, 0, 0), centre=(0.0, 0, 0), focal=50.0, width=40, height=30):
    c2w = np.eye(4)
    c2w[:3, :3] = quats_to_matrices(normalize_quats(np.array(quat, float)))
    c2w[:3, 3] = centre
    return Camera([[focal, 0.5, 20], [0, focal, 15], [0, 0, 1]], c2w, width, height)


def about_y(angle):
    return (math.cos(angle / 2), 0, math.sin(angle / 2), 0)


CAMERAS = [camera(), camera((0.9, 0.1, 0.3, -0.2), (1, 0, 0.5), 60), camera((-0.7, -0.2, -0.6, 0.1), (2, -1, 0), 40)]


def angle_between(a, b):
    return math.acos(min(1, (np.trace(a.rotation @ b.rotation.T) - 1) / 2))


def test_a_path_passes_through_every_given_camera():
    path = between(CAMERAS, 21)
    assert len(path) == 21
    for given, passed in zip(CAMERAS, path[::10], strict=True):
        np.testing.assert_allclose(passed.c2w, given.c2w, atol=1e-9)
        np.testing.assert_allclose(passed.K, given.K, atol=1e-9)
        assert (passed.width, passed.height) == (given.width, given.height)


def test_centres_and_intrinsics_move_straight_and_rotations_turn_evenly():
    path = between(CAMERAS[:2], 9)
    for i, c in enumerate(path):
        np.testing.assert_allclose(c.centre, np.array([1, 0, 0.5]) * i / 8, atol=1e-9)
        assert c.K[0, 0] == pytest.approx(50 + 10 * i / 8)
    turns = [angle_between(a, b) for a, b in pairwise(path)]
    np.testing.assert_allclose(turns, angle_between(path[0], path[-1]) / 8, atol=1e-7)


def test_an_orbit_looks_at_one_point_from_an_ellipse_around_the_mean_camera():
    pair = [camera(about_y(0.1), (-0.5, 0, 0)), camera(about_y(-0.1), (0.5, 0, 0))]
    path = orbit(pair, 12, depth=5.0)
    assert len(path) == 12
    target = np.array([0, 0, 5.0])
    height = max(c.centre[1] for c in path)
    assert height > 0
    for c in path:
        seen = c.rotation @ (target - c.centre)
        np.testing.assert_allclose(seen[:2], 0, atol=1e-9)
        assert seen[2] > 0
        assert c.centre[2] == pytest.approx(0, abs=1e-9)
        assert (c.centre[0] / 0.5) ** 2 + (c.centre[1] / height) ** 2 == pytest.approx(1)
    np.testing.assert_allclose(np.mean([c.centre for c in path], axis=0), 0, atol=1e-9)
    assert path[0].centre[0] == pytest.approx(0.5)
    np.testing.assert_allclose(path[3].rotation.T[:, 0], [1, 0, 0], atol=1e-9)  # no roll


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: between([], 3), "cameras"),
        (lambda: between([camera(), camera(width=41)], 3), "cameras"),
        (lambda: between(CAMERAS, 0), "frames"),
        (lambda: between(CAMERAS, 2.5), "frames"),
        (lambda: orbit([], 3, 1.0), "cameras"),
        (lambda: orbit(CAMERAS, True, 1.0), "frames"),
        (lambda: orbit(CAMERAS, 3, 0.0), "depth"),
        (lambda: orbit(CAMERAS, 3, math.inf), "depth"),
        (lambda: orbit(CAMERAS, 3, "near"), "depth"),
    ],
)
def test_unusable_arguments_are_named(make, field):
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.where == field


def test_a_path_through_many_cameras_meets_them_without_a_jerk_or_a_detour():
    rng = np.random.default_rng(3)
    cameras = [camera(about_y(0.1 * i * (-1) ** (i // 3)), (0.5 * i, rng.uniform(-0.2, 0.2), 0)) for i in range(7)]
    path = between(cameras, 6 * 40 + 1)
    for i, given in enumerate(cameras):
        np.testing.assert_allclose(path[40 * i].c2w, given.c2w, atol=1e-9)
    poses = np.stack([one.c2w[:3] for one in path])
    steps = np.diff(poses, axis=0)
    turns = np.abs(np.diff(steps, axis=0)).max(axis=(1, 2))
    straight = np.diff(np.stack([one.c2w[:3] for one in cameras]), axis=0)
    corners = np.abs(np.diff(straight, axis=0)).max() / 40  # of a path of straight lines
    assert turns.max() < 0.5 * corners
    for i in range(6):  # no farther aside than a tenth of the way
        along = poses[40 * i : 40 * i + 41, :, 3]
        a, b = cameras[i].centre, cameras[i + 1].centre
        away = np.linalg.norm(np.cross(along - a, (b - a) / np.linalg.norm(b - a)), axis=1)
        assert away.max() < 0.1 * np.linalg.norm(b - a)
        assert (np.diff(along[:, 0]) > 0).all()  # never back


def test_gaussians_without_views_are_seen_from_outside_and_from_all_sides() -> None:
    """Whatever one in forty of them does: the box of the others fills much of a view, upright and in its middle."""
    rng = np.random.default_rng(0)
    means = rng.uniform(-1, 1, (4000, 3)) * (3, 1, 2)
    means[::40] *= 1000
    origin = np.array([5.0, -40, 7])
    scene = replace(make_list(4000, 0, rng), means=means, origin=origin)
    corners = 0.9 * np.stack(np.meshgrid([-3, 3], [-1, 1], [-2, 2]), axis=-1).reshape(-1, 3) + origin
    front, *sides = outside(scene), *ring(scene, 6)
    for view in (front, *sides):
        points = (corners - view.centre) @ view.rotation.T
        u, v = (points @ view.K.T)[:, :2].T / points[:, 2]
        assert points[:, 2].min() > 0
        far = max(np.abs(2 * u / view.width - 1).max(), np.abs(2 * v / view.height - 1).max())
        assert 0.25 < far < 1
        middle = view.K @ view.rotation @ (origin - view.centre)
        np.testing.assert_allclose(middle[:2] / middle[2], (view.width / 2, view.height / 2), atol=0.05 * view.height)
        assert view.rotation[0, 1] == pytest.approx(0, abs=1e-9) and view.rotation[1, 1] > 0.9
    assert (front.rotation == np.eye(3)).all()
    away = np.stack([view.centre for view in sides]) - origin
    turns = np.sort(np.arctan2(away[:, 0], away[:, 2]))
    assert np.diff([*turns, turns[0] + 2 * math.pi]).max() < math.pi / 2
    assert away[:, 1].min() < 0 < away[:, 1].max()
    assert outside(replace(scene, means=np.zeros_like(means))).centre @ (0, 0, 1) < origin[2]
