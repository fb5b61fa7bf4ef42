"""Gaussians check themselves once, name what is wrong, and know their layers."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_cameras, make_smooth_gaussians, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.editing import select_views
from tinysplat_runtime.gaussian.gaussians import Gaussians


def test_cameras_must_fit_the_grid():
    g = make_smooth_gaussians(2, 4, 5)
    for cameras in (g.cameras[:1], (g.cameras[0], g.cameras[1].resized(5, 4))):
        with pytest.raises(InputError) as caught:
            replace(g, cameras=cameras)
        assert caught.value.where == "cameras"


def test_arrays_become_float32_in_c_order():
    g = make_smooth_gaussians(1, 3, 4)
    other = Gaussians(g.means.astype(np.float64), np.asfortranarray(g.quats), g.scales, g.opacities, g.sh, g.cameras)
    assert other.means.dtype == np.float32 and other.quats.flags.c_contiguous


def test_flat_holds_all_layers_and_pads_lower_degrees():
    g = make_smooth_gaussians(2, 8, 9, degree=2, layers=3)
    flat = g.flat()
    assert len(g.layers) == 3 and flat.opacities.shape == (g.count,)
    assert flat.sh.shape == (g.count, 9, 3)
    assert (flat.sh[g.opacities.size :, 1:] == 0).all()
    np.testing.assert_array_equal(flat.means[: g.opacities.size], g.means.reshape(-1, 3))


def test_layers_must_be_per_pixel_and_share_the_origin():
    g = make_smooth_gaussians(2, 8, 9, layers=2)
    (layer,) = g.extra_layers
    nested, of_another = replace(layer, extra_layers=(layer,)), select_views(layer, [0])
    for wrong in (replace(layer, cameras=()), replace(layer, origin=np.ones(3)), nested, of_another):
        with pytest.raises(InputError) as caught:
            replace(g, extra_layers=(wrong,))
        assert caught.value.where.startswith("layer1")


def free(count=3, **fields):
    rows = {
        "means": np.zeros((count, 3)),
        "quats": np.ones((count, 4)),
        "scales": np.ones((count, 3)),
        "opacities": np.full(count, 0.5),
        "sh": np.zeros((count, 1, 3)),
    }
    return Gaussians(**{**rows, **fields})


def test_values_are_accepted_to_their_ends():
    assert free(opacities=[0, 1, 0.5]).opacities.tolist() == [0, 1, 0.5]
    assert free(scales=np.zeros((3, 3))).count == 3
    assert free(quats=[[0, 0, 0, 1e-30]] * 3).count == 3
    for sign in (1, -1):
        assert free(origin=[0, sign * 1e15, 0]).origin[1] == sign * 1e15
    for origin in ([0, 0], [0, np.nan, 0], [0, 1.01e15, 0], [0, -1.01e15, 0], np.zeros((3, 1))):
        with pytest.raises(InputError) as caught:
            free(origin=origin)
        assert caught.value.where == "origin"


@pytest.mark.parametrize(
    ("changes", "where", "words"),
    [
        ({"opacities": [0.5, 1.5, -1]}, "opacities[1]", "1.5 (2 such), expected 0 to 1"),
        ({"opacities": [-1, 0.5, 0.5]}, "opacities[0]", "-1.0 (1 such), expected 0 to 1"),
        ({"scales": [[1, 1, 1], [1, 1, -2], [1, -1, 1]]}, "scales[1, 2]", "-2.0 (2 such), expected ≥ 0"),
        ({"quats": [[1, 0, 0, 0], [0] * 4, [0] * 4]}, "quats[1]", "(2 such), expected a non-zero quaternion"),
        ({"means": [[0, 0, 0], [0, 0, 1e39], [0, 0, 0]]}, "means[1, 2]", "inf (1 such), expected finite numbers"),
        ({"means": np.zeros((3, 4))}, "means", "shape (3, 4), expected (3, 3) as opacities have (3,)"),
        ({"quats": np.ones((3, 3))}, "quats", "shape (3, 3), expected (3, 4)"),
        ({"scales": np.ones((2, 3))}, "scales", "shape (2, 3), expected (3, 3)"),
        ({"sh": np.ones((3, 1))}, "sh", "shape (3, 1), expected (3, 'B', 3)"),
        ({"sh": np.ones((3, 5, 3))}, "", "5 basis functions"),
        ({"means": "abc"}, "means", "not an array of numbers"),
        ({"cameras": make_cameras(1, 1, 3)}, "cameras", "1 of sizes [(1, 3)]…, expected one per view of (3,)"),
    ],
)
def test_what_is_wrong_is_counted_and_the_first_is_shown(changes, where, words):
    with pytest.raises(InputError) as caught:
        free(**changes)
    assert tells(str(caught.value), words) and (caught.value.where or "") == where


@pytest.mark.parametrize("lead", [(0,), (2, 3), (1, 0, 3), (1, 2, 3, 4)])
def test_leading_shapes_are_of_a_list_or_of_views(lead):
    shapes = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "sh": (1, 3)}
    with refusing(InputError, "(N,) or (V, H, W)"):
        Gaussians(**{name: np.ones((*lead, *shape)) for name, shape in shapes.items()})
