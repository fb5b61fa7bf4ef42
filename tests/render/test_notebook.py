"""Gaussians in a notebook: a picture of bounded size, and figures."""

from __future__ import annotations

import io

import pytest
from PIL import Image
from scenes import make_gaussians

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render.notebook import html, png


@pytest.mark.parametrize(("size", "shown"), [((6, 8), (8, 6)), ((2, 768), (384, 1)), ((500, 4), (3, 384))])
def test_the_picture_is_the_first_view_s_and_at_most_384_pixels_long(
    size: tuple[int, int], shown: tuple[int, int]
) -> None:
    data = png(make_gaussians(1, *size, degree=0))
    assert data and Image.open(io.BytesIO(data)).size == shown


def test_figures_stand_beside_it() -> None:
    gaussians = make_gaussians(2, 6, 8, degree=1, layers=2)
    text = html(gaussians)
    for row in (
        f"<tr><th>Gaussians</th><td>{gaussians.count}</td></tr>",
        "<tr><th>SH degree</th><td>1</td></tr>",
        "<tr><th>layers</th><td>2x6x8 + 2x3x4</td></tr>",
        f"<td>{gaussians.count * 4 * 23 / 1e6:.1f} MB</td>",
    ):
        assert row in text
    assert text.count("data:image/png;base64,") == 1
    flat = gaussians.flat()
    points = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh)
    assert png(points) is None and "<img" not in html(points)
