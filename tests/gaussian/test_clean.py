"""What floats beside a scene is found and named before it goes; what hangs together stays, however sparse it is."""

import numpy as np
from numpy.typing import NDArray
from scenes import Heard, make_cameras, make_smooth_gaussians, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian import MAP, REMOVE
from tinysplat_runtime.gaussian.clean import cleaned, floaters
from tinysplat_runtime.gaussian.gaussians import Gaussians

RNG = np.random.default_rng(0)


def listed(*groups: tuple[NDArray, float]) -> Gaussians:
    """Round Gaussians of groups of means (N, 3), each of one standard deviation."""
    means = np.concatenate([means for means, _ in groups])
    scales = np.concatenate([np.full((len(means), 3), size) for means, size in groups])
    quats, ones = np.tile([1.0, 0, 0, 0], (len(means), 1)), np.ones(len(means))
    cameras = tuple(make_cameras(2))
    return Gaussians(means, quats, scales, 0.8 * ones, np.zeros((len(means), 4, 3)), viewpoints=cameras)


SURFACE = (np.c_[np.mgrid[-1:1:160j, -1:1:160j].reshape(2, -1).T, np.full(25_600, 3.0)], 0.01)
BACKGROUND = (np.c_[np.mgrid[-60:60:10j, -60:60:10j].reshape(2, -1).T, np.full(100, 50.0)], 5.0)
STRAYS = (RNG.uniform((-1, -1, 0.5), (1, 1, 2), (12, 3)), 0.004)
SPECK = (RNG.normal((0.5, 0, 1.2), 0.01, (20, 3)), 0.01)


def test_strays_and_specks_float_and_a_sparse_background_does_not() -> None:
    scene = listed(SURFACE, BACKGROUND, STRAYS, SPECK)
    np.testing.assert_array_equal(np.flatnonzero(floaters(scene)), np.arange(25_700, 25_732))
    told = Heard()
    clean = cleaned(scene, REMOVE, as_list=True, threads=1, told=told)
    assert clean.count == 25_700 and clean.viewpoints == scene.viewpoints and tells(told.lines[0], "32 25,732")
    shown = cleaned(scene, MAP, as_list=True, threads=1)
    changed = (shown.sh != scene.sh).any(axis=(1, 2))
    assert shown.count == scene.count and changed[25_700:].all() and not changed[:25_700].any()


def test_nothing_of_what_hangs_together_goes() -> None:
    assert not floaters(listed(SURFACE, BACKGROUND)).any()
    assert not floaters(listed((np.zeros((1, 3)), 1.0))).any()


def test_of_pixels_floaters_become_transparent() -> None:
    scene = make_smooth_gaussians(2, 24, 32, layers=2)
    means = scene.means.copy()
    means[1, 5, 7] = scene.cameras[1].centre + np.array([0.01, 0, 0.2])
    clean = cleaned(scene.changed(means=means), REMOVE, as_list=False, threads=1)
    assert clean.cameras == scene.cameras and clean.opacities[1, 5, 7] == 0 and len(clean.layers) == 2
    assert (clean.opacities == scene.opacities).mean() > 0.95
    shown = cleaned(scene.changed(means=means), MAP, as_list=False, threads=1)
    np.testing.assert_array_equal(shown.opacities, scene.opacities)


def test_a_scene_without_anything_that_touches_is_refused() -> None:
    with refusing(InputError, "clean"):
        cleaned(listed((RNG.uniform(-9, 9, (5000, 3)), 1e-4)), REMOVE, as_list=True, threads=1)
