"""Gaussians in a notebook: a picture of bounded size, and figures."""

from __future__ import annotations

import io

import pytest
from PIL import Image
from scenes import make_gaussians

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render.notebook import html, png


@pytest.mark.parametrize(("height", "width"), [(6, 8), (2, 1500), (1200, 4)])
def test_the_picture_is_the_first_view_s_and_of_bounded_size(height: int, width: int) -> None:
    data = png(make_gaussians(1, height, width, degree=0))
    assert data
    shown = Image.open(io.BytesIO(data)).size
    scale = max(shown) / max(width, height)
    assert scale == 1 or max(shown) < 1000
    assert shown == (max(round(scale * width), 1), max(round(scale * height), 1))


def test_figures_stand_beside_it() -> None:
    gaussians = make_gaussians(2, 6, 8, degree=1, layers=2)
    text = html(gaussians)
    for figure in (f"{gaussians.count:,}", "2x6x8", "2x3x4"):
        assert figure in text
    assert text.count("data:image/png;base64,") == 1
    flat = gaussians.flat()
    points = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh)
    assert png(points) is None and "<img" not in html(points)
