"""What a list begins with: of a wall that many views show, one layer, and nothing that stands in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scenes import make_cameras

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.list.training.kept import opacities_kept
from tinysplat_runtime.scene.cameras import Camera

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


def kept(gaussians: Gaussians) -> Gaussians:
    """What stays of them, as a list."""
    opacities = np.concatenate([layer.ravel() for layer in opacities_kept(gaussians)])
    return gaussians.flat().taken(opacities >= 0).changed(opacities=opacities[opacities >= 0])


def row() -> list[Camera]:
    return make_cameras(VIEWS, HEIGHT, WIDTH, spacing=0.1, turn=0)


def views_of(gaussians: Gaussians) -> np.ndarray:
    """(N,) which view each is of, by its colour."""
    return (gaussians.sh[:, 0, 0] // (HEIGHT * WIDTH)).astype(int)


def test_of_views_that_show_the_same_as_finely_the_first_one_stays():
    whole = wall(row())
    thin = kept(whole)
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
    counts = np.bincount(views_of(kept(whole)), minlength=2)
    assert counts[1] == HEIGHT * WIDTH
    assert 0.9 < counts[0] / (HEIGHT * WIDTH) < 0.96  # all but the sixteenth that the other shows


def test_what_stands_before_what_other_views_see_goes():
    depths = np.full((VIEWS, HEIGHT, WIDTH), DEPTH)
    depths[0, 10:14, 12:20] = 0.6 * DEPTH  # the first view believes in something there, and the others see past it
    thin = kept(wall(row(), depths))
    z = thin.means[:, 2] - row()[0].centre[2]
    assert views_of(thin).tolist().count(0) == HEIGHT * WIDTH - 4 * 8
    assert (z > 0.9 * DEPTH).all()


def test_further_layers_stay_only_where_no_surface_is():
    behind = wall(row(), 0.8 * DEPTH)
    beyond = wall(row(), 2 * DEPTH)
    for layer, stays in ((behind, False), (beyond, True), (wall(row()), False)):
        thin = kept(replace(wall(row()), extra_layers=(layer,)))
        more = thin.count - kept(wall(row())).count
        assert (more > 0) == stays
        assert (thin.opacities[thin.count - more :] < 0.5 * 0.5).all()  # faint, for what they may stand before
