"""Gaussians check themselves once, name what is wrong, and know their layers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians


def _changed(g, field, index, value):
    array = getattr(g, field).copy()
    array[index] = value
    return {**{name: getattr(g, name) for name in FIELDS}, "cameras": g.cameras, field: array}


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("means", np.nan),
        ("sh", np.inf),
        ("opacities", 1.5),
        ("opacities", -0.1),
        ("scales", -1e-6),
        ("quats", 0.0),
    ],
)
def test_bad_values_are_refused_with_field_and_index(field, value):
    g = make_smooth_gaussians(2, 4, 5)
    with pytest.raises(InputError) as caught:
        Gaussians(**_changed(g, field, (1, 2, 3), value))
    assert caught.value.where.startswith(f"{field}[1, 2, 3")


@pytest.mark.parametrize("field", FIELDS)
def test_unlike_shapes_are_refused_with_the_field(field):
    g = make_smooth_gaussians(2, 4, 5)
    arrays = {name: getattr(g, name) for name in FIELDS}
    arrays[field] = arrays[field][..., :-1, :] if field != "opacities" else arrays[field][:, :-1]
    with pytest.raises(InputError):
        Gaussians(**arrays)


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
    with pytest.raises(InputError):
        replace(g, extra_layers=(replace(g.extra_layers[0], cameras=()),))
    with pytest.raises(InputError):
        replace(g, extra_layers=(replace(g.extra_layers[0], origin=np.ones(3)),))
