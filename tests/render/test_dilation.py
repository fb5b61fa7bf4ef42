"""Dilation in own pixels: surfaces stay closed from nearby, and hide no more than they should from afar."""

from dataclasses import replace

import numpy as np
import pytest

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.cameras import Camera

SIDE = 32


def wall(opacity=0.95, side=SIDE, focal=40.0):
    """A wall seen by one view, of points."""
    camera = Camera([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1]], np.eye(4), side, side)
    y, x = np.mgrid[:side, :side] + 0.5
    lead = (1, side, side)
    means = 2.0 * np.stack([(x - side / 2) / focal, (y - side / 2) / focal, np.ones_like(x)], axis=-1)
    return Gaussians(
        means[None],
        np.broadcast_to([1.0, 0, 0, 0], (*lead, 4)),
        np.zeros((*lead, 3)),
        np.full(lead, opacity),
        np.zeros((*lead, 1, 3)),
        [camera],
    )


def alpha(gaussians, size, compiled, dilation="own"):
    renderer = Renderer(gaussians, 1, dilation=dilation, compiled=compiled)
    image = renderer.render(gaussians.cameras[0], (size, size), outputs=("alpha",))["alpha"]
    margin = max(size // 8, 1)
    return image[margin:-margin, margin:-margin]


def listed(gaussians):
    """The same as a list that knows where its photo was taken."""
    return replace(gaussians.flat(), viewpoints=gaussians.cameras)


by_both = pytest.mark.parametrize("compiled", [False, True], ids=["numpy", "compiled"])


@by_both
@pytest.mark.parametrize("times", [2, 4, 10])
def test_an_enlarged_surface_has_no_gaps(times, compiled):
    at_coded_size = alpha(wall(), SIDE, compiled)
    enlarged = alpha(wall(), times * SIDE, compiled)
    # between the pixels' centres it covers less than at them, by the ripple of Gaussians 1/√0.3 deviations apart
    assert enlarged.min() > 0.9 * at_coded_size.min()
    assert alpha(wall(), times * SIDE, compiled, "screen").min() < 0.5


@by_both
@pytest.mark.parametrize("times", [1, 2, 10])
def test_a_list_is_enlarged_as_a_photo_would_be_and_drawn_small_as_3dgs_defines(times, compiled):
    planes = wall()
    camera, found = planes.cameras[0], listed(planes)

    def drawn(size, dilation):
        renderer = Renderer(found, 1, dilation=dilation, compiled=compiled)
        return renderer.render(camera, (size, size), outputs=("alpha",))["alpha"]

    small = SIDE // times
    np.testing.assert_array_equal(drawn(small, "own"), drawn(small, "screen"))
    enlarged, margin = drawn(times * SIDE, "own"), times * SIDE // 8
    assert enlarged[margin:-margin, margin:-margin].min() > 0.9 * alpha(planes, SIDE, compiled).min()


@by_both
def test_a_surface_far_away_does_not_vanish(compiled):
    distant = wall(opacity=0.5, side=128, focal=160.0)
    assert alpha(distant, 4, compiled).min() > 0.5
