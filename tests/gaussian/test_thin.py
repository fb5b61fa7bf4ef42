"""Thinning a capture: of a wall that many views show, one layer stays, and what stands in the way goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_cameras

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.thin import _depths, _near, _pixels, thinned
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

VIEWS, HEIGHT, WIDTH, DEPTH = 8, 24, 32, 4.0


def wall(cameras: list[Camera], depths: np.ndarray | float = DEPTH, opacity: float = 0.5) -> Gaussians:
    """Every pixel of every view at the z that `depths`, (V, H, W) or one for all, says."""
    height, width = cameras[0].height, cameras[0].width
    y, x = np.mgrid[:height, :width] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    z = np.broadcast_to(depths, (len(cameras), height, width))
    means = [z[v, ..., None] * (pixels @ np.linalg.inv(c.K).T) @ c.rotation + c.centre for v, c in enumerate(cameras)]
    quats = np.broadcast_to([1.0, 0, 0, 0], (*z.shape, 4))
    sh = np.arange(z.size, dtype=float).reshape(*z.shape, 1, 1) * np.ones(3)  # tells which is which
    return Gaussians(np.stack(means), quats, np.full((*z.shape, 3), 0.05), np.full(z.shape, opacity), sh, cameras)


def row() -> list[Camera]:
    return make_cameras(VIEWS, HEIGHT, WIDTH, spacing=0.1, turn=0)


def views_of(gaussians: Gaussians) -> np.ndarray:
    """(N,) which view each is of, by its colour."""
    return (gaussians.sh[:, 0, 0] // (HEIGHT * WIDTH)).astype(int)


def test_of_views_that_show_the_same_as_finely_the_first_one_stays():
    whole = wall(row())
    thin = thinned(whole, shown=1)
    counts = np.bincount(views_of(thin), minlength=VIEWS)
    assert counts[0] == HEIGHT * WIDTH
    assert thin.count < 0.4 * whole.count and not thin.cameras
    # and nothing is left open: every pixel of the wall lies within two pixels' widths of one that stayed
    nearest = [np.square(thin.means - mean).sum(axis=1).min() for mean in whole.means.reshape(-1, 3)[::37]]
    assert np.sqrt(max(nearest)) < 2 * DEPTH / whole.cameras[0].focal


def test_the_view_that_shows_finest_wins_whatever_its_number():
    cameras = row()[:2]
    K = cameras[1].K.copy()
    K[0, 0] = K[1, 1] = 4 * K[0, 0]
    whole = wall([cameras[0], Camera(K, cameras[0].c2w, WIDTH, HEIGHT)])
    counts = np.bincount(views_of(thinned(whole, shown=1)), minlength=2)
    assert counts[1] == HEIGHT * WIDTH
    assert 0.9 < counts[0] / (HEIGHT * WIDTH) < 0.96  # all but the sixteenth that the other shows


def test_what_stands_before_what_other_views_see_goes():
    depths = np.full((VIEWS, HEIGHT, WIDTH), DEPTH)
    depths[0, 10:14, 12:20] = 0.6 * DEPTH  # the first view believes in something there, and the others see past it
    thin = thinned(wall(row(), depths))
    z = thin.means[:, 2] - row()[0].centre[2]
    assert views_of(thin).tolist().count(0) == HEIGHT * WIDTH - 4 * 8
    assert (z > 0.9 * DEPTH).all()


def test_as_many_views_show_a_place_as_may_and_a_lone_one_always():
    cameras = row()
    apart = Camera(cameras[0].K, [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]], WIDTH, HEIGHT)
    whole = wall([*cameras[:-1], apart])
    for shown in (1, 2, 3):
        views = views_of(thinned(whole, shown=shown))
        assert (np.bincount(views)[[*range(shown), -1]] == HEIGHT * WIDTH).all()
    assert thinned(whole).count == thinned(whole, shown=2).count > thinned(whole, shown=1).count


def test_further_layers_stay_only_where_no_surface_is():
    behind = wall(row(), 0.8 * DEPTH)
    beyond = wall(row(), 2 * DEPTH)
    for layer, stays in ((behind, False), (beyond, True), (wall(row()), False)):
        thin = thinned(replace(wall(row()), extra_layers=(layer,)))
        more = thin.count - thinned(wall(row())).count
        assert (more > 0) == stays
        np.testing.assert_allclose(thin.opacities[thin.count - more :], 0.5 * 0.15, rtol=1e-6)


def test_threads_change_nothing():
    whole = wall(row(), DEPTH * np.random.default_rng(0).uniform(0.95, 1.05, (VIEWS, HEIGHT, WIDTH)))
    one, many = thinned(whole), thinned(whole, Crew(3).map)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))


@pytest.mark.parametrize(("away", "stays"), [
    (-0.031, [False, True]), (-0.029, [True, False]), (0.029, [True, False]), (0.031, [True, False]),
])  # fmt: skip
def test_surfaces_are_one_to_three_hundredths_of_their_depth(away: float, stays: list[bool]) -> None:
    """Two photos from one place: the first one's wall lies nearer or farther by a share of the second one's.

    One that lies before the other's stands in the way; the second's, seen from the first, lies behind or is the same.
    """
    cameras = make_cameras(1, HEIGHT, WIDTH) * 2
    depths = np.array([DEPTH * (1 + away), DEPTH])[:, None, None]
    counts = np.bincount(views_of(thinned(wall(cameras, depths), shown=1)), minlength=2)
    if away > 0.03:  # now it is the second one's that stands before the first one's
        stays = [True, False]
    assert (counts > 0).tolist() == stays


@pytest.mark.parametrize(("finer", "first_stays"), [(1.09, True), (1.11, False), (0.92, True)])
def test_the_first_view_serves_where_it_is_about_as_fine(finer: float, first_stays: bool) -> None:
    (camera,) = make_cameras(1, HEIGHT, WIDTH, shift=(0, 0))
    other = Camera(camera.K * [[finer, 1, 1], [1, finer, 1], [1, 1, 1]], camera.c2w, WIDTH, HEIGHT)
    thin = thinned(wall([camera, other]), shown=1)
    middle = (np.arange(HEIGHT)[:, None] * WIDTH + np.arange(WIDTH))[6:18, 8:24]
    kept = set(thin.sh[:, 0, 0].astype(int).tolist())
    assert (set(middle.ravel().tolist()) <= kept) == first_stays
    assert (set((HEIGHT * WIDTH + middle).ravel().tolist()) <= kept) != first_stays


def test_eight_views_are_looked_at_the_nearest_first() -> None:
    cameras = make_cameras(11, 4, 5, spacing=0.3, turn=0)
    for n, camera in enumerate(cameras):  # farther and farther apart, so that no two are as near
        cameras[n] = Camera(camera.K, camera.c2w + 1e-3 * n * n * np.eye(4)[:1].T * np.eye(4)[3], 5, 4)
    depths = [np.full((4, 5), 3.0)] * 11
    near = _near(cameras, depths)
    assert near[0] == [1, 2, 3, 4, 5, 6, 7, 8] and near[4] == [3, 5, 2, 6, 1, 7, 0, 8]
    assert near[10] == [9, 8, 7, 6, 5, 4, 3, 2]
    assert _near(cameras[:3], depths[:3]) == [[1, 2], [0, 2], [1, 0]]
    turned = [Camera(c.K, c.c2w @ np.diag([-1.0, 1, -1, 1]), 5, 4) if n == 1 else c for n, c in enumerate(cameras)]
    assert _near(turned, depths)[0] == [2, 3, 4, 5, 6, 7, 8, 9]  # 2 apart in direction, more than all but the last
    assert _near(cameras, [np.full((4, 5), np.inf)] * 11)[4] == near[4]


def test_places_are_found_in_pictures_by_hand() -> None:
    """A camera at (1, 0, 0) looks along z; f is 4 across and 2 down, the principal point (3, 1)."""
    camera = Camera([[4.0, 0, 3], [0, 2, 1], [0, 0, 1]], [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], 6, 3)
    places = {  # relative to the origin at z = 10: column and row in the picture, or None beside it
        (1, 0, -8): (3, 1), (-0.5, 0, -8): (0, 1), (2.49, 1.99, -8): (5, 2), (2.51, 0, -8): None, (1, 2.01, -8): None,
        (-0.51, 0, -8): None, (1, -1.01, -8): None, (1, 0, -10): None, (1, 0, -12): None, (1, -0.99, -8): (3, 0),
    }  # fmt: skip
    means = np.array(list(places), np.float32)
    row, column, z, inside = _pixels(means, np.array([0.0, 0, 10]), camera)
    for n, wanted in enumerate(places.values()):
        assert inside[n] == (wanted is not None)
        assert (column[n], row[n]) == (wanted or (0, 0))
    np.testing.assert_allclose(z, means[:, 2] + 10)
    one = wall([camera], DEPTH)
    np.testing.assert_allclose(_depths(one, 0), DEPTH, rtol=1e-6)
    assert np.isinf(_depths(wall([camera], -DEPTH), 0)).all() and _depths(one, 0).dtype == np.float32
