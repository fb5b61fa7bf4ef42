"""The float64 rasteriser at chosen pixels against the definition evaluated at every pixel."""

from __future__ import annotations

import numpy as np
import pytest
from reference.rasteriser import render_reference
from scenes import make_smooth_gaussians

from tinysplat.reference.pixels import choose_pixels, render_pixels


@pytest.mark.parametrize("degree", [0, 1, 3, 4])
def test_chosen_pixels_agree_with_the_definition_to_rounding(degree: int) -> None:
    gaussians = make_smooth_gaussians(2, 24, 32, degree, layers=2, seed=degree)
    camera, background = gaussians.cameras[1], (0.2, 0.3, 0.4)
    pixels = choose_pixels(24, 32, share=0.4, least=10, seed=degree)
    whole = render_reference(gaussians, camera, background)["rgb"].reshape(-1, 3)
    assert np.abs(render_pixels(gaussians, camera, pixels, background) - whole[pixels]).max() < 1e-12


def test_far_from_the_origin_nothing_is_lost() -> None:
    gaussians = make_smooth_gaussians(1, 16, 16, 1, origin=np.array([4e6, -2e6, 1e5]))
    pixels = np.arange(256)
    whole = render_reference(gaussians, gaussians.cameras[0])["rgb"].reshape(-1, 3)
    assert np.abs(render_pixels(gaussians, gaussians.cameras[0], pixels) - whole).max() < 1e-8


def test_pixels_are_sorted_distinct_and_as_many_as_asked_for() -> None:
    pixels = choose_pixels(100, 200, share=0.01, least=50)
    assert len(pixels) == 200
    assert (np.diff(pixels) > 0).all()
    assert len(choose_pixels(8, 8, share=0.01, least=500)) == 64
