"""Dilation in own pixels: surfaces stay closed from nearby, and hide no more than they should from afar."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.render.prepare import prepare
from tinysplat_runtime.render.project import Splats, View, _factors, project
from tinysplat_runtime.scene.cameras import Camera

SIDE = 32


def wall(opacity=0.95, side=SIDE, focal=40.0, deviation=0.0):
    """A wall seen by one view, of discs of a standard deviation in pixels: by default points."""
    camera = Camera([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1]], np.eye(4), side, side)
    y, x = np.mgrid[:side, :side] + 0.5
    lead = (1, side, side)
    means = 2.0 * np.stack([(x - side / 2) / focal, (y - side / 2) / focal, np.ones_like(x)], axis=-1)
    scales = np.full((*lead, 3), 2 * deviation / focal) * [1, 1, 0]
    return Gaussians(
        means[None], np.broadcast_to([1.0, 0, 0, 0], (*lead, 4)), scales, np.full(lead, opacity),
        np.zeros((*lead, 1, 3)), [camera],
    )  # fmt: skip


def alpha(gaussians, size, compiled, dilation="own"):
    renderer = Renderer(gaussians, 1, dilation=dilation, compiled=compiled)
    image = renderer.render(gaussians.cameras[0], (size, size), outputs=("alpha",))["alpha"]
    margin = max(size // 8, 1)
    return image[margin:-margin, margin:-margin]


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
def test_what_closes_a_surface_by_itself_is_not_widened(compiled):
    """0.3 px² of its own photo in all, or what it has of its own and the screen's 0.3."""
    wide, narrow = (wall(deviation=deviation) for deviation in (0.6, 0.3))
    np.testing.assert_allclose(alpha(wide, 4 * SIDE, compiled), alpha(wide, 4 * SIDE, compiled, "screen"), atol=2e-6)
    points = alpha(wall(), 4 * SIDE, compiled)  # the same footprint without any of its own
    np.testing.assert_allclose(alpha(narrow, 4 * SIDE, compiled), points, atol=2e-5)


@by_both
@pytest.mark.parametrize("times", [2, 4])
def test_a_reduced_surface_covers_about_what_it_covered(times, compiled):
    """Less by what of its faded Gaussians lies under 1/255; dilated by the screen alone it would cover everything."""
    half = wall(opacity=0.4)
    at_coded_size = alpha(half, SIDE, compiled).mean()
    assert at_coded_size - 0.15 < alpha(half, SIDE // times, compiled).mean() < at_coded_size
    assert alpha(half, SIDE // times, compiled, "screen").mean() > 0.95


@by_both
def test_a_surface_far_away_does_not_vanish(compiled):
    distant = wall(opacity=0.5, side=128, focal=160.0)
    assert alpha(distant, 4, compiled).min() > 0.5


@by_both
def test_at_the_coded_size_nothing_changes(compiled):
    for dilation in ("own", "screen"):
        np.testing.assert_allclose(
            alpha(wall(), SIDE, compiled, dilation), alpha(wall(), SIDE, False, "screen"), atol=2e-6
        )


def test_the_exponent_s_factors_and_the_opacity_that_is_left_by_matrices():
    """Σ + e·1 of the module's docstring, e = max(0.3, 0.3·m² − λ); where m < 1 the opacity pays for the difference."""
    rng = np.random.default_rng(0)
    own = np.array([0.0, 0.01, 0.125, 0.5, 0.99, 1.0, 1.5, 4.0, 20.0, 0.5, 3.0])
    count = len(own)
    jacobian = rng.standard_normal((2, 3, count))
    axes = rng.standard_normal((3, 3, count)) * np.exp(rng.uniform(-3, 1, (3, 1, count)))
    axes[:, :, -2:] = 0  # points
    (alpha_x, beta_x, gamma, half_width, half_height), log_share = _factors(jacobian, axes, own)
    plain, no_share = _factors(jacobian, axes, None)
    assert no_share == 0
    for n, m in enumerate(own):
        projected = jacobian[:, :, n] @ axes[:, :, n]
        sigma = projected @ projected.T
        wanted = 0.3 * max(m, 1 / 8) ** 2 if m > 0 else 0.3  # m = 0 stands for no photo's pixel
        for factors, dilation in (
            ((alpha_x[n], beta_x[n], gamma[n]), max(0.3, wanted - np.linalg.eigvalsh(sigma)[0])),
            ([factor[n] for factor in plain[:3]], 0.3),
        ):
            inverse = np.linalg.inv(sigma + dilation * np.eye(2)) / 2
            a, b, c = factors
            np.testing.assert_allclose([[a * a, a * b], [a * b, b * b + c * c]], inverse, rtol=1e-6, atol=1e-12)
        dilated = sigma + max(0.3, wanted - np.linalg.eigvalsh(sigma)[0]) * np.eye(2)
        np.testing.assert_allclose([half_width[n] ** 2, half_height[n] ** 2], 2 * np.diag(dilated), rtol=1e-6)
        left = np.linalg.det(sigma + wanted * np.eye(2)) / np.linalg.det(sigma + 0.3 * np.eye(2))
        assert log_share[n] == pytest.approx(0.5 * np.log(left) if wanted < 0.3 else 0, abs=1e-6)


@pytest.mark.parametrize(("opacity", "shown"), [(0.06, 0), (0.065, 8 * 8)])
def test_splats_that_fade_below_one_255th_are_not_drawn(opacity, shown):
    """Points at a quarter of their photo's size fade to a sixteenth: 0.0627 leaves 1/255.

    Of 0.065, footprints of 0.145 px are left: on either axis, half of the points lie as near to a pixel's centre.
    """
    gaussians = wall(opacity=opacity, side=16)
    (block,) = prepare(gaussians, by_view=True)
    splats = Splats(block.size)
    view = View.of(gaussians.cameras[0].resized(4, 4), gaussians.origin, 0.01)
    rows = project(block, view, (4, 4), splats)
    assert rows.size == shown
    np.testing.assert_allclose(np.exp(splats.log_opacities[rows]), opacity / 16, rtol=1e-5)
