"""What a rendered picture means: colours, depths, order and layers, each on a scene small enough to work out."""

import math

import numpy as np
import pytest
from scenes import make_cameras, make_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, render
from tinysplat_runtime.scene.cameras import Camera

C0 = 0.28209479177387814  # ½·√(1/π)
C1 = 0.4886025119029199  # √(3/4π)

CAMERA = Camera([[50.0, 0, 16.5], [0, 50.0, 12.5], [0, 0, 1]], np.eye(4), 33, 25)  # looks through pixel (12, 16)
CENTRE = (12, 16)
ATOL = 1e-4  # as docs/NUMERICS.md has it


def splats(means, *, colours=None, scale=0.05, opacity=0.8, sh=None):
    """Round Gaussians of given colours, or SH coefficients (N, S, 3)."""
    means = np.atleast_2d(np.asarray(means, float))
    n = len(means)
    if sh is None:
        sh = (np.broadcast_to(np.asarray(colours if colours is not None else 0.5, float), (n, 3)) - 0.5)[:, None] / C0
    return Gaussians(
        means, np.tile([1.0, 0, 0, 0], (n, 1)), np.full((n, 3), scale), np.broadcast_to(opacity, n), np.asarray(sh)
    )


@pytest.mark.parametrize(
    ("function", "axis", "sign"), [(1, 1, -1), (2, 2, 1), (3, 0, -1)], ids=["Y1: -y", "Y2: +z", "Y3: -x"]
)
def test_first_degree_colours_have_the_signs_of_3dgs(function, axis, sign):
    sh = np.zeros((1, 4, 3))
    sh[0, function] = 0.4, -0.4, 0
    mean = np.array([0.12, 0.08, 1.0])
    along = (mean / np.linalg.norm(mean))[axis]
    image = render(splats(mean, sh=sh), CAMERA, outputs=("rgb", "alpha"))
    row, column = (int(v) for v in (50 * mean[1] + 12.5, 50 * mean[0] + 16.5))
    red, green, blue = image["rgb"][row, column] / image["alpha"][row, column]
    assert red == pytest.approx(0.5 + sign * C1 * along * 0.4, abs=ATOL)
    assert green == pytest.approx(0.5 - sign * C1 * along * 0.4, abs=ATOL)
    assert blue == pytest.approx(0.5, abs=ATOL)


def test_a_splat_is_its_opacity_at_the_centre_and_a_dilated_gaussian_around():
    alpha = render(splats([0, 0, 2.0], scale=0.04, opacity=0.7), CAMERA, outputs=("alpha",))["alpha"]
    variance = (0.04 * 50 / 2.0) ** 2 + 0.3
    for distance in range(4):
        assert alpha[12, 16 + distance] == pytest.approx(0.7 * math.exp(-(distance**2) / (2 * variance)), abs=ATOL)


def test_the_footprint_ends_where_alpha_is_one_255th_and_not_at_three_deviations():
    alpha = render(splats([0, 0, 2.0], scale=0.2, opacity=0.99), CAMERA, outputs=("alpha",))["alpha"][12]
    sigma = math.sqrt((0.2 * 50 / 2.0) ** 2 + 0.3)
    reach = sigma * math.sqrt(2 * math.log(255 * 0.99))
    assert reach > 3.3 * sigma
    assert (np.abs(np.arange(33) - 16)[alpha > 0]).max() == min(16, int(reach))
    assert alpha[alpha > 0].min() >= 1 / 255 - ATOL


def test_a_splat_that_would_bring_transmittance_under_1e_4_is_not_blended():
    opacities = np.array([0.98, 0.98, 0.9, 0.5])  # leaves 0.02, 4e-4, then 4e-5 is refused and the pixel stops
    image = render(splats([[0, 0, z] for z in (1.0, 2, 3, 4)], opacity=opacities), CAMERA, outputs=("alpha",))
    assert image["alpha"][CENTRE] == pytest.approx(1 - 4e-4, abs=ATOL)


def test_depth_is_z_and_not_ray_length_and_weighs_like_colour():
    image = render(splats([[0.2, 0.1, 1.5]], scale=0.1), CAMERA, outputs=("depth", "alpha"))
    seen = image["alpha"] > 0
    np.testing.assert_allclose(image["depth"][seen], 1.5, atol=ATOL)
    assert not image["depth"][~seen].any()
    two = render(splats([[0, 0, 1.0], [0, 0, 3.0]], opacity=0.5), CAMERA, outputs=("depth",))["depth"]
    assert two[CENTRE] == pytest.approx((0.5 * 1 + 0.25 * 3) / 0.75, abs=ATOL)


def test_the_near_plane_drops_means_at_or_before_it():
    scene = splats([[0, 0, 0.5]], scale=0.01)
    assert render(scene, CAMERA, near_plane=0.49, outputs=("alpha",))["alpha"].any()
    for near_plane in (0.5, 2.0):
        assert not render(scene, CAMERA, near_plane=near_plane, outputs=("alpha",))["alpha"].any()
    assert not render(splats([[0, 0, 0.01], [0, 0, -3.0], [0, 0, 0]]), CAMERA, outputs=("alpha",))["alpha"].any()


def test_results_have_the_documented_shapes_and_types():
    scene = splats([0, 0, 2.0])
    image = render(scene, CAMERA)
    assert image.shape == (25, 33, 3) and image.dtype == np.float32
    named = render(scene, CAMERA, outputs=("alpha", "depth", "rgb"))
    assert {name: (a.shape, a.dtype) for name, a in named.items()} == {
        "alpha": ((25, 33), np.float32),
        "depth": ((25, 33), np.float32),
        "rgb": ((25, 33, 3), np.float32),
    }
    np.testing.assert_array_equal(named["rgb"], image)
    assert list(render(scene, CAMERA, outputs="depth")) == ["depth"]


def test_all_layers_are_drawn_and_may_have_different_degrees():
    front, back = make_gaussians(2, 8, 12, degree=2, seed=1), make_gaussians(2, 4, 6, degree=0, seed=2)
    layered = Gaussians.stacked([front, back])
    camera = make_cameras(1, 8, 12)[0]
    picture = render(layered, camera, **DEFINITION)
    np.testing.assert_allclose(picture, render(layered.flat(), camera), atol=ATOL)
    assert not np.array_equal(picture, render(front, camera, **DEFINITION))


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"gaussians": None}, "gaussians"),
        ({"camera": np.eye(4)}, "camera"),
        ({"size": (0, 5)}, "size"),
        ({"size": (5, 2.5)}, "size"),
        ({"outputs": ("rgb", "normals")}, "outputs"),
        ({"outputs": 3}, "outputs"),
        ({"background": (0, np.nan, 0)}, "background"),
        ({"background": "white"}, "background"),
        ({"near_plane": -1}, "near_plane"),
        ({"near_plane": math.inf}, "near_plane"),
        ({"threads": 0}, "threads"),
        ({"threads": 1.5}, "threads"),
    ],
)
def test_unusable_arguments_are_named(changes, field):
    arguments = {"gaussians": splats([0, 0, 2.0]), "camera": CAMERA, **changes}
    with pytest.raises(InputError) as caught:
        render(**arguments)
    assert str(caught.value.where).startswith(field)
