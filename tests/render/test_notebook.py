"""Gaussians in a notebook: a picture of bounded size, and figures."""

import io
import re

import pytest
from PIL import Image
from scenes import make_gaussians

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render.notebook import html, png


@pytest.mark.parametrize(("height", "width"), [(6, 8), (2, 1500), (1200, 4)])
def test_the_picture_is_the_first_view_s_and_of_bounded_size(height: int, width: int) -> None:
    made = (png(make_gaussians(1, times * height, times * width, degree=0)) for times in (1, 2))
    shown, of_more = (Image.open(io.BytesIO(data or b"")).size for data in made)
    scale = max(shown) / max(width, height)
    assert shown == of_more or max(shown) < 100
    assert shown == (max(round(scale * width), 1), max(round(scale * height), 1))


def test_figures_stand_beside_it() -> None:
    gaussians = make_gaussians(2, 6, 8, degree=1, layers=2)
    text = html(gaussians)
    for figures in (rf"\b{gaussians.count}\b", r"\b2\W*.\W*6\W*.\W*8\b", r"\b2\W*.\W*3\W*.\W*4\b"):
        assert re.search(figures, text)
    assert text.count("data:image/png;base64,") == 1
    flat = gaussians.flat()
    points = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh)
    assert png(points) is None and "<img" not in html(points)
