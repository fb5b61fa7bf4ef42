"""Steps of free Gaussians by hand: how far, of what kind, and what goes on with those that are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scenes import make_free_gaussians

from tinysplat_runtime.refine.descent import units
from tinysplat_runtime.refine.free import FreeGaussians
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

RUN = Crew(1).map


def test_a_unit_is_the_pixel_of_the_view_that_shows_largest() -> None:
    made = make_free_gaussians(3, 0, np.random.default_rng(0))
    made = replace(made, means=np.array([[0, 0, 5.0], [0, 0, -4], [0, 0, 20]]), origin=np.array([1.0, 0, 0]))
    near = Camera([[10.0, 0, 2], [0, 10, 2], [0, 0, 1]], np.eye(4), 4, 4)
    back = Camera([[20.0, 0, 2], [0, 20, 2], [0, 0, 1]], np.diag([-1.0, 1, -1, 1]), 4, 4)
    c2w = np.eye(4)
    c2w[2, 3] = -20
    far = Camera([[50.0, 0, 2], [0, 50, 2], [0, 0, 1]], c2w, 4, 4)
    np.testing.assert_allclose(units(made, [near]), [0.5, 1, 2], rtol=1e-6)
    np.testing.assert_allclose(units(made, [near, back]), [0.5, 0.2, 2], rtol=1e-6)
    np.testing.assert_allclose(units(made, [near, back, far]), [0.5, 0.2, 0.8], rtol=1e-6)


def test_axes_too_thin_for_logarithms_begin_at_a_ten_thousandth_of_the_unit() -> None:
    made = make_free_gaussians(2, 0, np.random.default_rng(0))
    made = replace(made, scales=np.array([[0, 1e-3, 0.5], [3e-5, 1e-9, 2]]), opacities=np.array([0.0, 1.0]))
    found = FreeGaussians(made, np.array([2.0, 0.1]), RUN)
    np.testing.assert_allclose(found.gaussians().scales, [[2e-4, 1e-3, 0.5], [3e-5, 1e-5, 2]], rtol=1e-5)
    np.testing.assert_allclose(found.opacities, [1e-9, 1 - 1e-6], rtol=1e-4)
    assert found.count == 2 and found.values.shape == (10, 128) and (found.values[6, 2:] == -np.inf).all()
