"""One colour for all coefficients: what input views see, and when it may take their place."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.one_colour import AVERAGED, as_seen, nearest_cameras
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.sh import C0, sh_basis


def _weakly_view_dependent(views: int = 3, degree: int = 3, share: float = 0.02, **options):
    scene = make_smooth_gaussians(views, 24, 32, degree, **options)
    weights = np.full(scene.sh.shape[-2], share, np.float32)
    weights[0] = 1
    return replace(scene, sh=scene.sh * weights[:, None])


def _seen_in_float64(layer, view, row, column, camera):
    """Colour, less 0.5, by the definition."""
    ray = layer.means[view, row, column].astype(np.float64) + layer.origin - layer.cameras[camera].centre
    return sh_basis(ray / np.linalg.norm(ray), layer.degree) @ layer.sh[view, row, column].astype(np.float64)


@pytest.mark.parametrize("origin", [np.zeros(3), np.array([3e5, -2e5, 1e6])])
def test_the_colour_is_the_mean_of_what_the_own_and_the_nearest_camera_see(origin):
    layer = _weakly_view_dependent(origin=origin)
    found = as_seen(layer, np.inf)
    assert found.degree == 0 and found.cameras == layer.cameras and np.array_equal(found.means, layer.means)
    for view, row, column in np.ndindex(3, 24, 32):
        seen = [_seen_in_float64(layer, view, row, column, c) for c in nearest_cameras(layer.cameras)[view, :AVERAGED]]
        np.testing.assert_allclose(found.sh[view, row, column, 0] * C0, np.mean(seen, axis=0), atol=3e-6)


def test_a_file_holds_the_colours_that_its_views_see_and_says_what_was_left_out():
    scene = _weakly_view_dependent(share=0.004)
    data = Runtime(threads=1).compress(scene, qp=-12)
    decoded = Runtime(threads=1).decompress(data)
    assert decoded.degree == 0
    (entry,) = [e for e in inspect_bytes(data)["left_out"] if e["what"] == "sh degree"]
    assert (entry["kept"], entry["of"]) == (0, 3)
    wanted = as_seen(scene, np.inf).sh
    assert np.sqrt(np.square(decoded.sh - wanted).mean()) * C0 < 0.01


def test_steps_finer_than_the_disagreement_bring_the_coefficients_back():
    scene, runtime = _weakly_view_dependent(share=0.2), Runtime(threads=1)
    coarse, fine = (runtime.decompress(runtime.compress(scene, qp=qp)).degree for qp in (12, -36))
    assert coarse == 0 < fine
